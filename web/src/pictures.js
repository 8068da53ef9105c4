/**
 * The pictures that a page carries: found by their ids, decoded when first shown, the last few kept. A page of many is
 * long: its first pictures are shown while the rest is read.
 *
 * The format is that of `encode` in whitted/reports/pictures.py. Nothing is fetched.
 */

const KEPT = 8; // decoded pictures in memory: two shown, their reference, and those flipped to

const WAIT = 20; // milliseconds between looks at a page that is still read

const loaded = new Map(); // id -> promise of a picture; the least recently used comes first

/**
 * Return a promise of the manifest's entry with `radiance`, `stderr` (or null): Float32Array [height, width,
 * channels], and `mean`, the mean of all finite values.
 */
export function load(entry) {
  const found = loaded.get(entry.id) ?? read(entry);
  loaded.delete(entry.id);
  loaded.set(entry.id, found);
  for (const id of [...loaded.keys()].slice(0, -KEPT)) loaded.delete(id);
  return found;
}

/** Return a promise of an element's text; it may stand in a part of the page that is still on its way. */
export async function textOf(id) {
  const find = () => document.getElementById(id);
  while (document.readyState === "loading" && !find()?.nextSibling) await new Promise((go) => setTimeout(go, WAIT));
  return find().textContent;
}

async function read(entry) {
  const [radiance, stderr] = await Promise.all([
    textOf(`picture-${entry.id}`).then(decode),
    entry.has_stderr ? textOf(`stderr-${entry.id}`).then(decode) : null,
  ]);
  return { ...entry, radiance, stderr, mean: finiteMean(radiance) };
}

/** Base64, zlib, and the four bytes of each little-endian float in four planes, one after another. */
async function decode(text) {
  const binary = atob(text);
  const packed = new Uint8Array(binary.length);
  for (let i = 0; i < packed.length; i++) packed[i] = binary.charCodeAt(i);
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  const n = bytes.length / 4;
  const words = new Uint32Array(n);
  for (let i = 0; i < n; i++) {
    words[i] = bytes[i] | (bytes[n + i] << 8) | (bytes[2 * n + i] << 16) | (bytes[3 * n + i] << 24);
  }
  return new Float32Array(words.buffer);
}

function finiteMean(values) {
  let sum = 0, count = 0;
  for (const value of values) {
    if (Number.isFinite(value)) {
      sum += value;
      count += 1;
    }
  }
  return count ? sum / count : 0;
}
