// The library in Node; `main.rs` is the same as a native program.
// Usage: node run.cjs MODULE.js

const user = require(process.argv[2]);

console.log(user.plan());
console.log(Array.from(user.learn(), (share) => share.toFixed(2)).join(" "));
