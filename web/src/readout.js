/** The values at a pixel, for the table under the controls and for people who listen; and other facts in words. */

import { MODES } from "./display.js";

const NAMES = ["A", "B", "Reference"];

/**
 * Return the values of A, B and the reference at a pixel: `name`, `radiance`, `stderr` (or null), one number for each
 * channel, and `error`, the relative error (or null); null where there is no such picture.
 */
export function valuesAt(pictures, reference, [x, y]) {
  return [...pictures, reference].map((picture, i) => {
    if (!picture) return null;
    const n = picture.channels.length, pixel = y * picture.width + x;
    const cut = (values) => values && [...values.slice(n * pixel, n * (pixel + 1))];
    const error = reference && picture !== reference ? MODES.error.value(picture, reference, pixel) : null;
    return { name: NAMES[i], radiance: cut(picture.radiance), stderr: cut(picture.stderr), error };
  });
}

/** The inside of a table of `valuesAt` a pixel; null shows the table empty. */
export function table(channels, pixel, values) {
  const place = pixel ? `Linear radiance at x ${pixel[0]}, y ${pixel[1]}` : "Point at a pixel for its linear radiance";
  const rows = pixel ? values.filter(Boolean) : NAMES.map((name) => ({ name }));
  const cell = ({ radiance, stderr }, c) => {
    if (!radiance) return "<td>–</td>";
    return `<td>${radiance[c].toPrecision(4)}${stderr ? `<small>± ${stderr[c].toPrecision(2)}</small>` : ""}</td>`;
  };
  return `<caption>${place}</caption>
    <thead><tr><td></td>${[...channels, "Error"].map((title) => `<th scope="col">${title}</th>`).join("")}</tr></thead>
    <tbody>${rows.map((row) => `<tr><th scope="row">${row.name}</th>
      ${channels.map((_, c) => cell(row, c)).join("")}<td>${percent(row.error)}</td></tr>`).join("")}</tbody>`;
}

/** The same, to be read out. */
export function spoken([x, y], values) {
  const rows = values.filter(Boolean).map(({ name, radiance, error }) => {
    const numbers = radiance.map((value) => value.toPrecision(4)).join(", ");
    return `${name}: ${numbers}${error === null ? "" : `, error ${percent(error)}`}`;
  });
  return `Pixel ${x}, ${y}. ${rows.join(". ")}.`;
}

/** A picture's name with the samples per pixel and the seconds that it took. */
export function title({ name, spp, seconds }) {
  const facts = [spp === null ? [] : `${spp} spp`, seconds === null ? [] : `${Number(seconds.toPrecision(3))} s`];
  return [name, facts].flat(2).join(", ");
}

export const percent = (value) => (value == null ? "–" : `${minus(Number((100 * value).toPrecision(2)))} %`);

export const stops = (value) => `${value > 0 ? "+" : ""}${minus(value)} ${Math.abs(value) === 1 ? "stop" : "stops"}`;

const minus = (value) => String(value).replace("-", "−");
