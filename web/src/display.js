/**
 * From radiance and its error to colours on the screen: one entry of `MODES` for each way to show a picture.
 *
 * Colours are sRGB (IEC 61966-2-1), clipped at 1, as those of whitted/tonemap.py. Errors are relative as in relMSE of
 * whitted/stats/metrics.py: with reference R, picture A, its standard error S, and means over a pixel's channels,
 *
 *     error = sqrt(mean((A - R)^2 / (R^2 + eps))),  signed = mean((A - R) / sqrt(R^2 + eps)),
 *     stderr = sqrt(mean(S^2 / (R^2 + eps))),       eps = 0.01 mean(R)^2,  the mean over the whole picture;
 *
 * so relMSE is the mean square of `error`. A standard error without a reference is relative to its own picture.
 */

import { rgb } from "d3-color";
import { interpolateRdBu, interpolateViridis } from "d3-scale-chromatic";

const EPSILON = 1e-2;
const NO_NUMBER = [128, 128, 128]; // grey is in neither map
const DECADES = 3; // that the logarithmic colour bar spans below its end

const viridis = table(interpolateViridis);
const redBlue = table((t) => interpolateRdBu(1 - t)); // red where the picture is too bright

const logarithmic = {
  map: viridis,
  ticks: [0.001, 0.01, 0.1, 1],
  position: (value) => 1 + Math.log10(value) / DECADES,
};

/**
 * Each mode has a `label` and `start`, the exposure it begins with, in stops. Unless it shows colours it has
 * `value(picture, reference, pixel)`, NaN where there is none; `map`, 256 colours; `position(value)` on the colour bar,
 * 0..1; and `ticks`, values on the bar at exposure 0. At exposure e a value shows as 2^e times it does at 0.
 */
export const MODES = {
  colour: { label: "Colour", start: 0 },
  error: {
    label: "Relative error",
    start: 0,
    ...logarithmic,
    value: (picture, reference, pixel) => reference
      ? rootMeanSquare(reference, pixel, (i) => picture.radiance[i] - reference.radiance[i])
      : NaN,
  },
  signed: {
    label: "Signed relative error",
    start: 2,
    map: redBlue,
    ticks: [-1, -0.5, 0, 0.5, 1],
    position: (value) => (value + 1) / 2,
    value: (picture, reference, pixel) => reference
      ? mean(reference, pixel, (i, square) => ratio(picture.radiance[i] - reference.radiance[i], Math.sqrt(square)))
      : NaN,
  },
  stderr: {
    label: "Relative standard error",
    start: 0,
    ...logarithmic,
    value: (picture, reference, pixel) => picture.stderr
      ? rootMeanSquare(reference ?? picture, pixel, (i) => picture.stderr[i])
      : NaN,
  },
};

/** Fill `bytes`, RGBA [height, width, 4], with the picture as the mode shows it. */
export function paint(bytes, mode, picture, reference, exposure) {
  const gain = 2 ** exposure;
  if (mode === "colour") paintColour(bytes, picture, gain);
  else paintValues(bytes, MODES[mode], picture, reference, gain);
}

function paintColour(bytes, { radiance, channels }, gain) {
  const n = channels.length;
  const [green, blue] = n === 1 ? [0, 0] : [1, 2];
  for (let i = 0, j = 0; i < bytes.length; i += 4, j += n) {
    bytes[i] = encoded(gain * radiance[j]);
    bytes[i + 1] = encoded(gain * radiance[j + green]);
    bytes[i + 2] = encoded(gain * radiance[j + blue]);
    bytes[i + 3] = 255;
  }
}

function paintValues(bytes, { map, position, value }, picture, reference, gain) {
  for (let pixel = 0, i = 0; i < bytes.length; pixel++, i += 4) {
    const t = position(gain * value(picture, reference, pixel));
    const colour = Number.isNaN(t) ? NO_NUMBER : map[Math.min(Math.max(Math.floor(256 * t), 0), 255)];
    for (let c = 0; c < 3; c++) bytes[i + c] = colour[c];
    bytes[i + 3] = 255;
  }
}

/** Linear radiance as 8-bit sRGB; NaN shows black. */
function encoded(linear) {
  const v = Math.min(Math.max(linear, 0), 1);
  return Math.floor(255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055) + 0.5);
}

/** The mean over a pixel's channels of `term(i, R_i^2 + eps)`. */
function mean(reference, pixel, term) {
  const n = reference.channels.length, floor = EPSILON * reference.mean ** 2;
  let sum = 0;
  for (let i = n * pixel; i < n * (pixel + 1); i++) sum += term(i, reference.radiance[i] ** 2 + floor);
  return sum / n;
}

function rootMeanSquare(reference, pixel, error) {
  return Math.sqrt(mean(reference, pixel, (i, square) => ratio(error(i) ** 2, square)));
}

/** A quotient where 0 / 0 is 0: no error of nothing. */
const ratio = (above, below) => (above === 0 ? 0 : above / below);

/** 256 colours, [red, green, blue] of 0..255. */
function table(interpolate) {
  return Array.from({ length: 256 }, (_, i) => {
    const { r, g, b } = rgb(interpolate((i + 0.5) / 256));
    return [r, g, b];
  });
}
