// Plans in the module of planning alone, which lpr-wasm/build.sh plan has made: prints what it answers, as the strings that it
// answers with, and how many bytes the module has with gzip.
// Usage: node tests/node/planner.mjs '[[["ROBOT", OBSTACLES, REQUEST], …], SETTINGS_OF_THE_MOTION_ALONG_A_PLAN]'

import { readFileSync } from "node:fs";
import { gzipSync } from "node:zlib";
import * as wasm from "../../lpr-wasm/pkg/lpr_wasm.js";

const module = readFileSync(new URL("../../lpr-wasm/pkg/lpr_wasm_bg.wasm", import.meta.url));
wasm.initSync({ module });

const [questions, motionSettings] = JSON.parse(process.argv[2]);
const answers = questions.map(([robot, obstacles, request]) => {
  const planner = new wasm.Planner(robot, JSON.stringify(obstacles));
  const question = JSON.stringify(request);
  const plan = planner.plan(question);
  const path = JSON.parse(plan).found?.path;
  const motion = path && planner.trajectory(JSON.stringify({ path, ...motionSettings }));
  return [planner.configurations(question, 20), plan, planner.candidates(question), motion ?? null];
});
console.log(JSON.stringify({ answers, gzip_bytes: gzipSync(module, { level: 9 }).length }));
