// Writes what the Python package ships for its pages: the viewer (viewer.js, viewer.css), the script that draws plots
// (plotly.js, its bundle of lines and bars, a quarter of the whole, which a browser reads for two seconds), and licences.

import { createHash } from "node:crypto";
import { copyFileSync, readdirSync, readFileSync, writeFileSync } from "node:fs";
import { build } from "esbuild";

const ASSETS = "../whitted/reports/assets";
const PLOTLY = "plotly.js-basic-dist-min";
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
const licences = (names) => names.map((name) => {
  const { version, license } = JSON.parse(read(`node_modules/${name}/package.json`));
  const file = readdirSync(`node_modules/${name}`).find((entry) => /^licen[cs]e/i.test(entry));
  return { title: `${name} ${version} (${license})`, text: read(`node_modules/${name}/${file}`).trim() };
});

const packages = licences(names.sort());
const header = `/* whitted's picture viewer, with ${packages.map(({ title }) => title).join(", ")}. Licences: LICENSES.txt.
   Built from web/src, sha256 ${digest}. */\n`;
writeFileSync(`${ASSETS}/viewer.js`, header + js.text);
writeFileSync(`${ASSETS}/viewer.css`, css.text);
copyFileSync(`node_modules/${PLOTLY}/plotly-basic.min.js`, `${ASSETS}/plotly.js`);
writeFileSync(`${ASSETS}/LICENSES.txt`, [...packages, ...licences([PLOTLY])].map(({ title, text }) => `${title}\n\n${text}\n`).join(`\n${"-".repeat(80)}\n\n`));
