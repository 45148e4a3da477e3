// Prints the hashes of the candidates of the first steps in wasm, as a JSON list.
// Usage: node tests/node/candidates.mjs STEPS

import wasm from "./module.mjs";

const bench = new wasm.CandidatesBench();
console.log(JSON.stringify(Array.from({ length: Number(process.argv[2]) }, (_, step) => bench.run(step))));
