// Writes the viewer that the Python package ships: viewer.js, viewer.css and the licences of what is bundled.

import { createHash } from "node:crypto";
import { readdirSync, readFileSync, writeFileSync } from "node:fs";
import { build } from "esbuild";

const ASSETS = "../whitted/reports/assets";
const TARGET = ["chrome123", "firefox120", "safari17.5"]; // the first with light-dark() in CSS

const read = (path) => readFileSync(path, "utf8");
const sources = readdirSync("src").sort();
const digest = createHash("sha256").update(sources.map((name) => read(`src/${name}`)).join("")).digest("hex");

const script = { entryPoints: ["src/main.js"], bundle: true, format: "iife", globalName: "WhittedViewer" };
const common = { minify: true, target: TARGET, legalComments: "none", write: false };
const { outputFiles: [js], metafile } = await build({ ...script, ...common, metafile: true, charset: "ascii" });
const { outputFiles: [css] } = await build({ ...common, entryPoints: ["src/viewer.css"] });

const bundled = Object.values(metafile.outputs)[0].inputs;
const used = Object.keys(bundled).filter((path) => bundled[path].bytesInOutput > 0);
const names = [...new Set(used.map((path) => /^node_modules\/((@[^/]+\/)?[^/]+)\//.exec(path)?.[1]).filter(Boolean))];
const packages = names.sort().map((name) => {
  const { version, license } = JSON.parse(read(`node_modules/${name}/package.json`));
  const file = readdirSync(`node_modules/${name}`).find((entry) => /^licen[cs]e/i.test(entry));
  return { title: `${name} ${version} (${license})`, text: read(`node_modules/${name}/${file}`).trim() };
});

const header = `/* whitted's picture viewer, with ${packages.map(({ title }) => title).join(", ")}. Licences: LICENSES.txt.
   Built from web/src, sha256 ${digest}. */\n`;
writeFileSync(`${ASSETS}/viewer.js`, header + js.text);
writeFileSync(`${ASSETS}/viewer.css`, css.text);
writeFileSync(`${ASSETS}/LICENSES.txt`, packages.map(({ title, text }) => `${title}\n\n${text}\n`).join(`\n${"-".repeat(80)}\n\n`));
