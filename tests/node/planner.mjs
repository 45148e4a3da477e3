// Plans in the module of planning alone, which lpr-wasm/build.sh plan has made: prints what it answers, as the strings that it
// answers with, and how many bytes the module has with gzip.
// Usage: node tests/node/planner.mjs '[["ROBOT", OBSTACLES, REQUEST], …]'

import { readFileSync } from "node:fs";
import { gzipSync } from "node:zlib";
import * as wasm from "../../lpr-wasm/pkg/lpr_wasm.js";

const module = readFileSync(new URL("../../lpr-wasm/pkg/lpr_wasm_bg.wasm", import.meta.url));
wasm.initSync({ module });

const answers = JSON.parse(process.argv[2]).map(([robot, obstacles, request]) => {
  const planner = new wasm.Planner(robot, JSON.stringify(obstacles));
  const question = JSON.stringify(request);
  return [planner.configurations(question, 20), planner.plan(question), planner.candidates(question)];
});
console.log(JSON.stringify({ answers, gzip_bytes: gzipSync(module, { level: 9 }).length }));
