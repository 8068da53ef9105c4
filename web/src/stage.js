/**
 * Two pictures on one OpenSeadragon viewport, so that zoom and pan are always in step; B is drawn right of a divider.
 *
 * OpenSeadragon brings mouse, touch and keyboard. Each picture is one tile, a canvas of ours that is painted anew.
 */

import OpenSeadragon from "openseadragon";

const LARGEST_ZOOM = 64; // screen pixels for a pixel of a picture

export class Stage {
  /** `on`: functions called with a pixel [x, y] or null (`hover`, `pick`), a key (`key`), or nothing (`move`). */
  constructor(element, cursor, on) {
    this.element = element;
    this.cursor = cursor;
    this.on = on;
    this.split = 0.5;
    element.addEventListener("pointermove", (event) => on.hover(this.pixelAt(event)));
    element.addEventListener("pointerleave", () => on.hover(null));
  }

  /** Make room for two pictures of a size, and show them whole; a promise. */
  open(width, height) {
    this.size = [width, height];
    this.layers = [0, 1].map(() => new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true }));
    this.viewer?.destroy(); // a new one measures the element, whose shape may be another
    this.viewer = new OpenSeadragon.Viewer({
      element: this.element,
      tileSources: this.layers.map((context, i) => ({ tileSource: source(context, i), x: 0, y: 0, width: 1 })),
      drawer: "canvas",
      showNavigationControl: false, // its images would be fetched
      animationTime: matchMedia("(prefers-reduced-motion: reduce)").matches ? 0 : 0.4,
      cooperativeGestures: true, // the wheel scrolls the page; with Ctrl it zooms
      gestureSettingsMouse: { clickToZoom: false, dblClickToZoom: true },
      gestureSettingsPen: { clickToZoom: false, dblClickToZoom: true },
      maxZoomPixelRatio: LARGEST_ZOOM,
      minZoomImageRatio: Math.min(0.5, width / this.element.clientWidth), // the whole at half size, and one to one
    });
    this.canvas = this.viewer.canvas; // what takes the focus
    this.canvas.setAttribute("role", "application"); // its arrow keys aren't for reading
    this.#listen();
    return new Promise((resolve) => {
      for (const end of ["open", "destroy"]) this.viewer.addOnceHandler(end, resolve);
    });
  }

  #listen() {
    const { viewer, on } = this;
    viewer.addHandler("tile-drawing", (event) => this.#compose(event));
    viewer.addHandler("viewport-change", () => on.move());
    viewer.addHandler("canvas-click", ({ quick, originalEvent }) => quick && on.pick(this.pixelAt(originalEvent)));
    viewer.addHandler("canvas-cooperative-gesture", (event) => {
      event.preventDefaultAction = true; // no message over the picture whenever the page is scrolled
    });
    viewer.addHandler("canvas-key", (event) => {
      event.preventDefaultAction = on.key(event.originalEvent);
    });
  }

  /** Paint layer 0 (A) or 1 (B): `fill` gets its bytes, RGBA. */
  paint(layer, fill) {
    const image = new ImageData(...this.size);
    fill(image.data);
    this.layers[layer].putImageData(image, 0, 0);
    this.viewer.forceRedraw();
  }

  /** Move the divider to a fraction of the width. */
  setSplit(fraction) {
    this.split = fraction;
    this.viewer.forceRedraw();
  }

  /** Screen pixels (of CSS) for a pixel of the pictures; undefined while they are being opened. */
  get zoom() {
    return this.#layer(0)?.viewportToImageZoom(this.viewer.viewport.getZoom(true));
  }

  zoomBy(factor) {
    this.viewer.viewport.zoomBy(factor).applyConstraints();
  }

  /** Show one pixel of the pictures on one of the screen. */
  zoomToPixels() {
    const { viewport } = this.viewer;
    viewport.zoomTo(this.#layer(0).imageToViewportZoom(1)).applyConstraints();
  }

  fit() {
    this.viewer.viewport.goHome();
  }

  /** The pixel [x, y] in the middle of the view, or the nearest to it. */
  centre() {
    const { x, y } = this.#layer(0).viewportToImageCoordinates(this.viewer.viewport.getCenter());
    return [x, y].map((value, axis) => Math.min(Math.max(Math.floor(value), 0), this.size[axis] - 1));
  }

  /** The pixel [x, y] under a pointer, or null. */
  pixelAt({ clientX, clientY }) {
    if (!this.#layer(0)) return null; // it is being opened
    const box = this.element.getBoundingClientRect();
    const point = this.#layer(0).viewerElementToImageCoordinates(new OpenSeadragon.Point(clientX - box.left, clientY - box.top));
    const pixel = [Math.floor(point.x), Math.floor(point.y)];
    return pixel.every((value, axis) => value >= 0 && value < this.size[axis]) ? pixel : null;
  }

  /** Mark a pixel, and bring it into view; null takes the mark away. */
  mark(pixel) {
    this.viewer.removeOverlay(this.cursor);
    if (!pixel) return;
    const { viewport } = this.viewer, unit = 1 / this.size[0];
    const place = new OpenSeadragon.Rect(pixel[0] * unit, pixel[1] * unit, unit, unit);
    this.viewer.addOverlay({ element: this.cursor, location: place });
    if (!viewport.getBounds().containsPoint(place.getCenter())) viewport.panTo(place.getCenter());
  }

  #layer(index) {
    return this.viewer?.world.getItemAt(index);
  }

  /** Before a picture is drawn: square pixels when enlarged, and B only right of the divider. */
  #compose({ tiledImage, context }) {
    context.imageSmoothingEnabled = this.zoom < 1;
    if (tiledImage !== this.#layer(1)) return;
    const { width, height } = context.canvas, left = Math.round(this.split * width);
    context.beginPath();
    context.rect(left, 0, width - left, height);
    context.clip();
  }
}

function source(context, name) {
  const { width, height } = context.canvas;
  return {
    width, height, tileWidth: width, tileHeight: height, minLevel: 0, maxLevel: 0,
    tileOverlap: 1, // of none, OpenSeadragon draws a tile one pixel larger, lest there be seams
    getTileUrl: () => `layer ${name}`, // tells tiles apart; it is never fetched
    hasTransparency: () => false,
    downloadTileStart: (job) => job.finish(context, null, "context2d"),
    downloadTileAbort() {},
  };
}
