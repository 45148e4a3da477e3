// Prints gradients of an update of Q-attention in wasm, as a JSON list.
// Usage: node tests/node/gradients.mjs

import wasm from "./module.mjs";

console.log(JSON.stringify(Array.from(new wasm.NetworksBench().gradients())));
