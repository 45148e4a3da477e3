// Prints the hashes of worlds after scripted demonstrations in wasm, as a JSON list.
// Usage: node tests/node/world_hash.mjs '[["TASK", "ROBOT", SEED], …]'

import wasm from "./module.mjs";

const scenes = JSON.parse(process.argv[2]);
console.log(JSON.stringify(scenes.map((scene) => wasm.demonstration_hash(...scene))));
