/** The worker that holds the agent and the simulated world: everything but drawing happens here. */

import init, { Demo } from './wasm/lpr_wasm.js';
import wasmUrl from './wasm/lpr_wasm_bg.wasm?url';
import type { Executed, Outcome, Plan, Planned, Reply, Request, SceneView, Start } from './protocol';

let demo: Demo | undefined;
let ready: Promise<unknown> | undefined;
const sizes = new Map<string, { loaded: number; total: number }>();

function post(reply: Reply, transfer: Transferable[] = []): void {
  self.postMessage(reply, { transfer });
}

/** Fetches `url` and tells how much of everything that is being fetched has come. */
async function fetchCounted(url: string): Promise<Response> {
  const response = await fetch(url);
  if (!response.ok || !response.body) throw new Error(`${url}: ${response.status} ${response.statusText}`);
  const size = { loaded: 0, total: Number(response.headers.get('content-length') ?? 0) };
  sizes.set(url, size);
  const count = new TransformStream<Uint8Array, Uint8Array>({
    transform(chunk, controller) {
      size.loaded += chunk.byteLength;
      // A compressed answer holds more than its length says.
      size.total = Math.max(size.total, size.loaded);
      const all = [...sizes.values()];
      const sum = (of: 'loaded' | 'total') => all.reduce((total, each) => total + each[of], 0);
      post({ kind: 'progress', loaded: sum('loaded'), total: sum('total') });
      controller.enqueue(chunk);
    },
  });
  const headers = { 'content-type': response.headers.get('content-type') ?? '' };
  return new Response(response.body.pipeThrough(count), { headers });
}

function start(demo: Demo): Start {
  return { scene: JSON.parse(demo.scene()) as SceneView, poses: demo.poses() };
}

function loaded(): Demo {
  if (!demo) throw new Error('no agent is loaded');
  return demo;
}

async function load(weightsUrl: string, seed: number): Promise<Start> {
  ready ??= init({ module_or_path: fetchCounted(wasmUrl) });
  const [weights] = await Promise.all([fetchCounted(weightsUrl).then((response) => response.arrayBuffer()), ready]);
  demo?.free();
  demo = new Demo(new Uint8Array(weights), seed);
  return start(demo);
}

function reset(seed: number): Start {
  loaded().reset(seed);
  return start(loaded());
}

function plan(): Planned {
  const begin = performance.now();
  const plan = JSON.parse(loaded().plan()) as Plan;
  const milliseconds = performance.now() - begin;
  const picture = loaded().picture();
  const { width, height } = picture;
  const rgb = picture.rgb();
  picture.free();
  return { plan, milliseconds, picture: { rgb, width, height } };
}

function execute(candidate: number): Executed {
  const begin = performance.now();
  const execution = loaded().execute(candidate);
  const milliseconds = performance.now() - begin;
  const outcome = JSON.parse(execution.outcome()) as Outcome;
  const poses = execution.poses();
  execution.free();
  return { outcome, poses, milliseconds };
}

async function answer({ call, args }: Request): Promise<unknown> {
  switch (call) {
    case 'load':
      return load(args[0] as string, args[1] as number);
    case 'reset':
      return reset(args[0] as number);
    case 'plan':
      return plan();
    case 'ghost':
      return loaded().ghost(args[0] as number);
    case 'execute':
      return execute(args[0] as number);
  }
}

self.onmessage = ({ data }: MessageEvent<Request>) => {
  answer(data).then(
    (result) => post({ kind: 'result', id: data.id, result }),
    (error: unknown) => post({ kind: 'error', id: data.id, message: error instanceof Error ? error.message : String(error) }),
  );
};
