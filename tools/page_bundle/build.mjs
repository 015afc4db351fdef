// Bundles what view.html uses of three.js (three_entry.mjs) into the Python package, with its licence.
import { readFile, writeFile } from "node:fs/promises";
import { build } from "esbuild";

const target = new URL("../../uniart_jax/export/page_files/", import.meta.url);
const three = new URL("node_modules/three/", import.meta.url);
const { version } = JSON.parse(await readFile(new URL("package.json", three), "utf8"));
const licence = (await readFile(new URL("LICENSE", three), "utf8")).trim();

const { outputFiles } = await build({
  entryPoints: ["three_entry.mjs"],
  bundle: true,
  minify: true,
  format: "iife",
  globalName: "THREE",
  target: "es2020",
  charset: "ascii",
  legalComments: "none",
  write: false,
});
const code = outputFiles[0].text;
if (/<\/script|<!--/i.test(code)) throw new Error("the bundle cannot stand inside a <script> element");
await writeFile(new URL("three.min.js", target), `/*! three.js ${version}\n\n${licence}\n*/\n${code}`);
await writeFile(new URL("THREE_LICENSE.txt", target), `${licence}\n`);
console.log(`three.js ${version}: ${Math.round(code.length / 1024)} KiB`);
