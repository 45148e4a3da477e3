// Prints what `lpr bench … --json` prints, for the benchmarks that run in wasm. With the path of the binary both are measured in
// turn, and `native_ratio` says how many times as long wasm takes, of the medians and of the least times.
// Usage: node tests/node/bench.mjs [target/release/lpr]

import { execFileSync } from "node:child_process";
import wasm from "./module.mjs";

const STEPS_PER_RUN = 100;
const TURNS = 5;

const physics = new wasm.PhysicsBench();
const candidates = new wasm.CandidatesBench();
const networks = new wasm.NetworksBench();
const BENCHES = [
  { name: "physics_arm10_10ms", subject: "simulation", runs: 300, parts: STEPS_PER_RUN, run: () => physics.run(STEPS_PER_RUN) },
  { name: "candidates_41", subject: "candidates", runs: 50, parts: 1, run: (i) => candidates.run(i) },
  // Both depths of Q-attention, 41 paths of the ranker and an update of Q-attention, at the widths of the preset `fast`.
  { name: "attend_fast", runs: 50, parts: 1, run: () => networks.attend() },
  { name: "rank_fast_b41_t30", runs: 50, parts: 1, run: () => networks.rank() },
  { name: "attention_update_fast_b16", runs: 10, parts: 1, run: () => networks.update() },
];

const ascending = (values) => values.toSorted((a, b) => a - b);
const median = (values) => ascending(values)[Math.floor(values.length / 2)];

function inWasm({ name, runs, parts, run }) {
  run(0);
  const times = Array.from({ length: runs }, (_, i) => {
    const start = performance.now();
    run(i + 1);
    return (performance.now() - start) / parts;
  });
  return { name, threads: 1, median_ms: median(times), min_ms: Math.min(...times), runs };
}

function native(binary, { name, subject }) {
  const printed = execFileSync(binary, ["bench", subject, "--threads", "1", "--json"], { encoding: "utf8" });
  return JSON.parse(printed).results.find((row) => row.name === name);
}

function measured(binary, bench) {
  const both = binary && bench.subject;
  const turns = Array.from({ length: binary ? TURNS : 1 }, () => ({ wasm: inWasm(bench), native: both && native(binary, bench) }));
  const least = (key) => Math.min(...turns.map((turn) => turn[key].min_ms));
  const middle = (key) => median(turns.map((turn) => turn[key].median_ms));
  const row = { ...turns[0].wasm, median_ms: middle("wasm"), min_ms: least("wasm"), runs: bench.runs * turns.length };
  const ratio = both && { median: middle("wasm") / middle("native"), least: least("wasm") / least("native") };
  return { row, ratio };
}

const binary = process.argv[2];
const results = BENCHES.map((bench) => measured(binary, bench));
const report = { results: results.map(({ row }) => row) };
if (binary) {
  report.native_ratio = Object.fromEntries(results.filter(({ ratio }) => ratio).map(({ row, ratio }) => [row.name, ratio]));
}
console.log(JSON.stringify(report));
