// Plans in a module of planning alone, which lpr-wasm/build.sh has made in that folder: prints what it answers, as the strings
// that it answers with, and how many bytes the module has with gzip.
// Usage: node tests/node/planner.mjs '["FOLDER", [["ROBOT", OBSTACLES, REQUEST], …], SETTINGS_OF_THE_MOTION_ALONG_A_PLAN]'
// A robot is a name, or { urdf, options, meshes: { name: text } }.

import { readFileSync } from "node:fs";
import { gzipSync } from "node:zlib";

const [folder, questions, motionSettings] = JSON.parse(process.argv[2]);
const built = (name) => new URL(`../../${folder}/${name}`, import.meta.url);
const wasm = await import(built("lpr_wasm.js"));
const module = readFileSync(built("lpr_wasm_bg.wasm"));
wasm.initSync({ module });

function fromFile({ urdf, options, meshes }, obstacles) {
  const bytes = (text) => new TextEncoder().encode(text);
  const file = new wasm.ArmFile(bytes(urdf), JSON.stringify(options));
  for (const name of JSON.parse(file.mesh_names())) file.add_mesh(name, bytes(meshes[name]));
  return file.planner(JSON.stringify(obstacles));
}

const answers = questions.map(([robot, obstacles, request]) => {
  const planner = typeof robot === "string" ? new wasm.Planner(robot, JSON.stringify(obstacles)) : fromFile(robot, obstacles);
  const question = JSON.stringify(request);
  const plan = planner.plan(question);
  const path = JSON.parse(plan).found?.path;
  const motion = path && planner.trajectory(JSON.stringify({ path, ...motionSettings }));
  return [planner.configurations(question, 20), plan, planner.candidates(question), motion ?? null];
});
console.log(JSON.stringify({ answers, gzip_bytes: gzipSync(module, { level: 9 }).length }));
