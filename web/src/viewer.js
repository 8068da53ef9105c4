/** The viewer of one page element: what is shown, and how it changes. */

import { MODES, paint } from "./display.js";
import { build, setBar, setOptions } from "./layout.js";
import { load } from "./pictures.js";
import { percent, spoken, stops, table, title, valuesAt } from "./readout.js";
import { Stage } from "./stage.js";

const STEP = 0.5; // of exposure by key, in stops
const LIMIT = 10;
const LETTERS = ["A", "B"];

export class Viewer {
  constructor(root, manifest) {
    this.entries = manifest;
    this.mode = "colour";
    this.exposures = startingExposures();
    this.hovered = this.cursor = null; // pixels [x, y]
    this.parts = build(root);
    this.stage = new Stage(this.parts.canvas, this.parts.cursor, {
      hover: (pixel) => this.#hover(pixel),
      pick: (pixel) => pixel && this.setCursor(pixel),
      key: (event) => this.#key(event),
      move: () => this.#showZoom(),
    });
    this.#connect();
    const scenes = [...new Set(this.entries.map(({ group }) => group))];
    setOptions(this.parts.scene, scenes.map((scene) => [scene, scene]), scenes[0]);
    this.parts.sceneField.hidden = scenes.length === 1;
    setOptions(this.parts.mode, Object.entries(MODES).map(([mode, { label }]) => [mode, label]), this.mode);
    this.ready = this.showScene(scenes[0]);
  }

  // What scripts may call.

  /** Show pictures, by their ids, as A and B; a promise. */
  async show(a, b) {
    const find = (id) => this.entries.find((entry) => entry.id === id);
    const [first, second] = [find(a), find(b)];
    const reference = find(first.reference ?? second.reference);
    const turn = (this.turn = {});
    const pictures = await Promise.all([first, second, reference].map((entry) => entry && load(entry)));
    if (this.turn === turn && first.group !== this.scene) await this.#open(first);
    if (this.turn !== turn) return; // others were chosen meanwhile
    this.pictures = pictures.slice(0, 2);
    this.reference = pictures[2] ?? null;
    this.#showNames();
    this.#paint();
  }

  /** Show a scene: the pictures that are named like those shown before, else its first two. */
  showScene(scene) {
    const entries = this.#scene(scene);
    const [a, b] = LETTERS.map((_, i) => {
      const before = this.pictures?.[i];
      return entries.find(({ name, spp }) => name === before?.name && spp === before?.spp) ?? entries[i] ?? entries[0];
    });
    return this.show(a.id, b.id);
  }

  /** Move the divider to a fraction of the width, 0..1. */
  setSlider(fraction) {
    this.parts.divider.value = 100 * fraction;
    this.#split();
  }

  /** Show a mode: colour, error, signed or stderr. */
  setMode(mode) {
    this.mode = mode;
    this.#paint();
  }

  /** Set the present mode's exposure, in stops. */
  setExposure(value) {
    this.exposures[this.mode] = clamp(value, -LIMIT, LIMIT);
    this.#paint();
  }

  /** Put the pixel cursor on [x, y]; null takes it away. */
  setCursor(pixel) {
    this.cursor = pixel;
    this.stage.mark(pixel);
    this.parts.probe.setAttribute("aria-pressed", pixel !== null);
    this.#showValues();
    this.#say(pixel ? spoken(pixel, valuesAt(this.pictures, this.reference, pixel)) : "Pixel cursor off");
  }

  reset() {
    this.exposures = startingExposures();
    this.setCursor(null);
    this.setSlider(0.5);
    this.setMode("colour");
    this.stage.fit();
    this.#say("Reset");
  }

  /** The values at a pixel: radiance `a`, `b`, `reference`, and `stderr` of a and b; null where there is none. */
  pixel(x, y) {
    const [a, b, reference] = valuesAt(this.pictures, this.reference, [x, y]);
    const stderr = { a: a.stderr, b: b.stderr };
    return { a: a.radiance, b: b.radiance, reference: reference && reference.radiance, stderr };
  }

  state() {
    const [a, b] = this.pictures.map(({ id }) => id);
    const { scene, mode, cursor, stage } = this;
    return { scene, a, b, mode, cursor, exposure: this.exposures[mode], slider: stage.split, zoom: stage.zoom };
  }

  // What people do.

  #connect() {
    const { parts, stage } = this;
    const on = (type, actions) => {
      for (const [name, action] of Object.entries(actions)) parts[name].addEventListener(type, action);
    };
    on("click", {
      zoomIn: () => stage.zoomBy(2),
      zoomOut: () => stage.zoomBy(1 / 2),
      fit: () => stage.fit(),
      pixels: () => stage.zoomToPixels(),
      reset: () => this.reset(),
      probe: () => this.#toggleCursor(),
    });
    on("change", {
      scene: () => this.showScene(parts.scene.value),
      a: () => this.show(parts.a.value, parts.b.value),
      b: () => this.show(parts.a.value, parts.b.value),
      mode: () => this.setMode(parts.mode.value),
    });
    on("input", {
      exposure: () => this.setExposure(parts.exposure.valueAsNumber),
      divider: () => this.#split(),
    });
  }

  /** Act on a key pressed in the picture; return whether OpenSeadragon shall leave it alone. */
  #key(event) {
    const { key, code, shiftKey } = event, letter = key.toLowerCase();
    if (event.ctrlKey || event.altKey || event.metaKey) return true;
    const arrow = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[key];
    const digit = /^Digit([1-9])$/.exec(code);
    if (arrow && this.cursor) this.#moveCursor(arrow, shiftKey ? 10 : 1);
    else if (digit) this.#flip(digit[1] - 1, shiftKey ? 1 : 0);
    else if (letter === "e") this.#changeExposure(key === "e" ? STEP : -STEP);
    else if (letter === "p") this.#toggleCursor();
    else if (letter === "r") this.reset();
    else if (key === "Escape" && this.cursor) this.setCursor(null);
    else return letter === "f"; // OpenSeadragon's own f mirrors the picture
    event.preventDefault();
    return true;
  }

  #moveCursor(direction, length) {
    const { size } = this.stage;
    this.setCursor(this.cursor.map((at, axis) => clamp(at + length * direction[axis], 0, size[axis] - 1)));
  }

  #toggleCursor() {
    this.setCursor(this.cursor ? null : this.stage.centre());
    if (this.cursor) this.stage.canvas.focus();
  }

  /** Show the scene's picture of an index as A (0) or B (1). */
  #flip(index, layer) {
    const entry = this.#scene(this.scene)[index];
    if (!entry) return;
    const ids = this.pictures.map(({ id }) => id);
    ids[layer] = entry.id;
    this.show(...ids);
    this.#say(`${LETTERS[layer]}: ${title(entry)}`);
  }

  #changeExposure(step) {
    this.setExposure(this.exposures[this.mode] + step);
    this.#say(`${this.parts.exposureName.textContent} ${stops(this.exposures[this.mode])}`);
  }

  #hover(pixel) {
    this.hovered = pixel;
    this.#showValues();
  }

  // What the page shows.

  #scene(scene) {
    return this.entries.filter(({ group }) => group === scene);
  }

  /** Make room for a scene's pictures. */
  async #open({ group, width, height }) {
    if (this.scene) this.setCursor(null);
    this.scene = group;
    this.parts.picture.style.setProperty("--wv-aspect", width / height);
    await this.stage.open(width, height);
    this.setSlider(this.stage.split);
  }

  /** Whether a mode has something to show. */
  #has(mode) {
    if (mode === "stderr") return this.pictures.some(({ stderr }) => stderr);
    return mode === "colour" || this.reference !== null;
  }

  #paint() {
    if (!this.#has(this.mode)) this.mode = "colour";
    const exposure = this.exposures[this.mode];
    this.pictures.forEach((picture, layer) => {
      this.stage.paint(layer, (bytes) => paint(bytes, this.mode, picture, this.reference, exposure));
    });
    this.#showDisplay();
    this.#showValues();
  }

  #split() {
    const { divider } = this.parts, share = divider.valueAsNumber;
    divider.setAttribute("aria-valuetext", `${Math.round(share)} % of the width is A`);
    this.stage.setSplit(share / 100);
  }

  #showNames() {
    const { parts, pictures, scene } = this;
    const options = this.#scene(scene).map((entry) => [entry.id, title(entry)]);
    parts.scene.value = scene;
    pictures.forEach((picture, i) => {
      setOptions(parts["ab"[i]], options, picture.id);
      parts[`tag${LETTERS[i]}`].textContent = `${LETTERS[i]}  ${title(picture)}`;
    });
    const described = pictures.map(({ text }, i) => `${LETTERS[i]}: ${text}`).join(" ");
    this.stage.canvas.setAttribute("aria-label", `Two pictures of ${scene}. ${described}`);
  }

  /** Show the mode, its exposure and its colour bar. */
  #showDisplay() {
    const { parts, mode } = this, { map, ticks, position } = MODES[mode], exposure = this.exposures[mode];
    for (const option of parts.mode.options) option.disabled = !this.#has(option.value);
    parts.mode.value = mode;
    parts.exposureName.textContent = map ? "Sensitivity" : "Exposure";
    parts.exposure.value = exposure;
    parts.exposureValue.textContent = stops(exposure);
    parts.exposure.setAttribute("aria-valuetext", stops(exposure));
    setBar(parts, map, ticks?.map((value) => [position(value), percent(value / 2 ** exposure)]));
  }

  #showZoom() {
    this.parts.zoom.textContent = `${Math.round(100 * this.stage.zoom)} %`;
  }

  /** Show the values under the pointer, else at the cursor. */
  #showValues() {
    if (!this.pictures) return;
    const pixel = this.hovered ?? this.cursor;
    const values = pixel && valuesAt(this.pictures, this.reference, pixel);
    this.parts.readout.innerHTML = table(this.pictures[0].channels, pixel, values);
  }

  #say(message) {
    this.parts.status.textContent = message;
  }
}

const startingExposures = () => Object.fromEntries(Object.entries(MODES).map(([mode, { start }]) => [mode, start]));

const clamp = (value, low, high) => Math.min(Math.max(value, low), high);
