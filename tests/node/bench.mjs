// Prints what `lpr bench simulation --json` prints, for the benchmarks that run in wasm. With the path of the binary both are
// measured in turn, and `native_ratio` says how many times as long wasm takes, of the medians and of the least times.
// Usage: node tests/node/bench.mjs [target/release/lpr]

import { execFileSync } from "node:child_process";
import wasm from "./module.mjs";

const NAME = "physics_arm10_10ms";
const STEPS_PER_RUN = 100;
const RUNS = 300;
const TURNS = 5;

const ascending = (values) => values.toSorted((a, b) => a - b);
const median = (values) => ascending(values)[Math.floor(values.length / 2)];

function inWasm() {
  const bench = new wasm.PhysicsBench();
  bench.run(STEPS_PER_RUN);
  const times = Array.from({ length: RUNS }, () => {
    const start = performance.now();
    bench.run(STEPS_PER_RUN);
    return (performance.now() - start) / STEPS_PER_RUN;
  });
  return { name: NAME, threads: 1, median_ms: median(times), min_ms: Math.min(...times), runs: RUNS };
}

function native(binary) {
  const printed = execFileSync(binary, ["bench", "simulation", "--threads", "1", "--json"], { encoding: "utf8" });
  return JSON.parse(printed).results.find((row) => row.name === NAME);
}

const binary = process.argv[2];
const turns = Array.from({ length: binary ? TURNS : 1 }, () => ({ wasm: inWasm(), native: binary && native(binary) }));
const least = (key) => Math.min(...turns.map((turn) => turn[key].min_ms));
const middle = (key) => median(turns.map((turn) => turn[key].median_ms));
const report = { results: [turns[0].wasm] };
if (binary) {
  report.results[0] = { ...turns[0].wasm, median_ms: middle("wasm"), min_ms: least("wasm"), runs: RUNS * TURNS };
  report.native_ratio = { median: middle("wasm") / middle("native"), least: least("wasm") / least("native") };
}
console.log(JSON.stringify(report));
