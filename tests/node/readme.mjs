// Runs the program of lpr-wasm/README.md, which lpr-wasm/build.sh plan has made the module for.
// Usage: node tests/node/readme.mjs README

import { readFileSync } from "node:fs";

const [program] = readFileSync(process.argv[2], "utf8").match(/(?<=```js\n)[^`][\s\S]*?(?=```)/);
const pkg = (name) => new URL(`../../lpr-wasm/pkg/${name}`, import.meta.url);
globalThis.wasm = readFileSync(pkg("lpr_wasm_bg.wasm"));
// A page fetches the module; Node has it in a file.
const runnable = program
  .replace("'./lpr_wasm.js'", JSON.stringify(pkg("lpr_wasm.js").href))
  .replace("await init();", "await init({ module_or_path: globalThis.wasm });");
await import(`data:text/javascript,${encodeURIComponent(runnable)}`);
