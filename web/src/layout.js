/** The viewer's elements: those that a script speaks to carry `data-part`. */

const KEYS = [
  ["← → ↑ ↓", "move the picture, or the pixel cursor while it is on (Shift: ten pixels)"],
  ["+ − 0", "zoom in, zoom out, fit"],
  ["e E", "half a stop brighter, darker"],
  ["1 … 9", "show the scene’s first, second, … picture as A; with Shift as B"],
  ["p Esc", "pixel cursor on, off; a click sets it too"],
  ["r", "reset"],
];

const TEMPLATE = `
<div class="wv-picture" data-part="picture">
  <div class="wv-stage">
    <div class="wv-canvas" data-part="canvas"></div>
    <span class="wv-tag" data-part="tagA"></span>
    <span class="wv-tag wv-right" data-part="tagB"></span>
    <input class="wv-divider" data-part="divider" type="range" min="0" max="100" step="any"
           aria-label="Divider: picture A on its left, B on its right">
  </div>
  <div class="wv-row">
    <button type="button" data-part="zoomOut" aria-label="Zoom out">−</button>
    <span class="wv-number" data-part="zoom"></span>
    <button type="button" data-part="zoomIn" aria-label="Zoom in">+</button>
    <button type="button" data-part="fit">Fit</button>
    <button type="button" data-part="pixels" title="One pixel of the picture on one of the screen">1:1</button>
    <button type="button" data-part="reset">Reset</button>
    <button type="button" data-part="probe" aria-pressed="false">Pixel cursor</button>
  </div>
</div>
<div class="wv-panel">
  <label data-part="sceneField"><span>Scene</span><select data-part="scene"></select></label>
  <label><span>A, left</span><select data-part="a"></select></label>
  <label><span>B, right</span><select data-part="b"></select></label>
  <label><span>Display</span><select data-part="mode"></select></label>
  <label><span data-part="exposureName"></span>
    <input data-part="exposure" type="range" min="-10" max="10" step="0.5">
    <span class="wv-number" data-part="exposureValue" aria-hidden="true"></span></label>
  <div class="wv-bar" data-part="bar" role="img"><div data-part="ramp"></div><div data-part="ticks"></div></div>
  <table class="wv-readout" data-part="readout"></table>
  <details><summary>Keys and gestures</summary>
    <p>While the picture has the focus:</p>
    <dl>${KEYS.map(([key, action]) => `<div><dt>${key}</dt><dd>${action}</dd></div>`).join("")}</dl>
    <p>Drag to move; Ctrl (on a Mac ⌘) and the wheel, two fingers, or a double click to zoom.</p></details>
</div>
<p class="wv-unseen" data-part="status" role="status" aria-live="polite"></p>
<div class="wv-cursor" data-part="cursor"></div>`;

/** Fill `root`, and return its parts by name. */
export function build(root) {
  root.innerHTML = TEMPLATE;
  const parts = Object.fromEntries([...root.querySelectorAll("[data-part]")].map((part) => [part.dataset.part, part]));
  parts.cursor.remove(); // the stage places it
  return parts;
}

/** Fill a select with [value, text] pairs, and choose a value. */
export function setOptions(select, options, value) {
  select.replaceChildren(...options.map(([value, text]) => new Option(text, value)));
  select.value = value;
}

/** Draw a colour bar: `ticks` are [place from 0 to 1, text]; where there is no `map` the bar is hidden. */
export function setBar({ bar, ramp, ticks: scale }, map, ticks) {
  bar.hidden = !map;
  if (!map) return;
  ramp.style.background = `linear-gradient(to right, ${map.filter((_, i) => i % 15 === 0).map((c) => `rgb(${c})`)})`;
  scale.innerHTML = ticks.map(([place, text]) => `<span style="left: ${100 * place}%">${text}</span>`).join("");
  bar.setAttribute("aria-label", `Colour bar from ${ticks[0][1]} to ${ticks.at(-1)[1]}`);
}
