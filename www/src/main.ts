/** The page: one agent in one scene. Plans, shows what it planned, runs a candidate, and so on until the episode ends. */

import { Engine } from './engine';
import { css, viridis } from './colors';
import { Jobs } from './jobs';
import { byId } from './page';
import type { Executed, Outcome, Picture, Plan, Planned, SceneView, Start } from './protocol';
import { fillTable, markSelected, ranking, rejectedText, whyText } from './table';
import { View } from './view';

/** An agent that the page brings along: an entry of weights/index.json. */
interface Agent {
  task: string;
  file: string;
  poses: 'learned' | 'demonstrator';
  command: string;
  commit: string;
  episodes: number;
  successes: number;
  wilson95: [number, number];
}

/** What the page does now. */
type Phase = 'loading' | 'planning' | 'ready' | 'running' | 'ended' | 'failed';

interface State {
  phase: Phase;
  scene: SceneView | undefined;
  plan: Plan | undefined;
  selected: number | null;
  outcomes: Outcome[];
}

const DEFAULT_SEED = 5000;

const state: State = { phase: 'loading', scene: undefined, plan: undefined, selected: null, outcomes: [] };
const view = new View(byId<HTMLCanvasElement>('view'));
const jobs = new Jobs();
let agents: Agent[] = [];
let engine = newEngine();
/** Rises with every new scene, so that what was asked for an old one is dropped. */
let era = 0;

function newEngine(): Engine {
  return new Engine((loaded, total) => {
    byId<HTMLProgressElement>('loading').value = loaded / total;
    byId('loading-text').textContent = `Loading ${(total / 1e6).toFixed(1)} MB`;
  });
}

function setPhase(phase: Phase): void {
  state.phase = phase;
  const canRun = phase === 'ready' && state.plan?.chosen != null;
  byId<HTMLButtonElement>('run-winner').disabled = !canRun;
  byId<HTMLButtonElement>('run-episode').disabled = !canRun;
  byId<HTMLButtonElement>('run-selected').disabled = !canRun || state.selected === null;
  byId('overlay').hidden = phase !== 'loading' && phase !== 'planning';
  byId<HTMLProgressElement>('loading').hidden = phase !== 'loading';
  if (phase === 'planning') byId('loading-text').textContent = 'Planning 41 paths';
}

/** Runs `work` unless a newer scene has begun when it continues; shows what fails. */
async function inEra(work: (isCurrent: () => boolean) => Promise<void>): Promise<void> {
  const mine = era;
  try {
    await work(() => mine === era);
  } catch (error) {
    if (mine === era) fail(error);
  }
}

function fail(error: unknown): void {
  setPhase('failed');
  byId('failure-text').textContent = error instanceof Error ? error.message : String(error);
  byId('failure').hidden = false;
}

function agent(): Agent {
  const chosen = agents.find(({ task }) => task === byId<HTMLSelectElement>('task').value) ?? agents[0];
  if (!chosen) throw new Error('weights/index.json lists no agent');
  return chosen;
}

function seed(): number {
  return byId<HTMLInputElement>('seed').valueAsNumber;
}

/** Loads the chosen agent into the scene of the seed. */
function loadAgent(): Promise<void> {
  era += 1;
  setPhase('loading');
  showProvenance(agent());
  return inEra(async (isCurrent) => {
    const weights = new URL(`weights/${agent().file}`, document.baseURI).href;
    const start = await engine.call('load', weights, seed());
    if (isCurrent()) await begin(start);
  });
}

/** Starts the scene of the seed anew. */
function reset(): Promise<void> {
  era += 1;
  setPhase('planning');
  return inEra(async (isCurrent) => {
    const start = await engine.call('reset', seed());
    if (isCurrent()) await begin(start);
  });
}

async function begin(start: Start): Promise<void> {
  state.scene = start.scene;
  state.outcomes = [];
  history.replaceState(null, '', `#task=${start.scene.task}&seed=${start.scene.seed}`);
  view.setScene(start.scene, start.poses);
  byId('outcome').textContent = `Task: ${start.scene.description}.`;
  byId('outcome').className = '';
  await plan();
}

/** Asks for the next decision and shows it. */
async function plan(): Promise<void> {
  setPhase('planning');
  const mine = era;
  const planned = await engine.call('plan');
  if (mine !== era) return;
  showPlan(planned);
  setPhase(planned.plan.chosen === null ? 'ended' : 'ready');
}

function showPlan({ plan, picture, milliseconds }: Planned): void {
  state.plan = plan;
  state.selected = null;
  view.setPlan(plan);
  view.setEmphasis(plan, { winner: plan.chosen, pointed: null });
  view.showAttention(byId<HTMLInputElement>('voxels').checked);
  showPicture(picture);
  showPose(plan);
  fillTable(byId('candidates'), plan, { point: (candidate) => void point(candidate), select });
  byId('rows').scrollTop = 0;
  byId('count').textContent = `(${plan.candidates.length}), step ${plan.step + 1}`;
  byId('why').textContent = whyText(plan);
  byId('rejected').textContent = rejectedText(plan);
  byId('timings').textContent = `Looked, planned and ranked in ${milliseconds.toFixed(0)} ms.`;
  const values = ranking(plan).map((idx) => plan.candidates[idx]!.value);
  byId('legend-high').textContent = values[0]?.toFixed(2) ?? '';
  byId('legend-low').textContent = values.at(-1)?.toFixed(2) ?? '';
}

function showPose({ goal, goal_value, depths }: Plan): void {
  const position = goal.position.map((metres, axis) => `${'xyz'[axis]} ${(100 * metres).toFixed(1)}`).join(', ');
  const by = depths.length > 0 ? `Q-attention chose it in ${depths.length} steps from coarse to fine, value ${goal_value?.toFixed(2)}` : 'The demonstrator gave it';
  byId('pose').textContent = `Grip to ${position} cm, then ${goal.gripper} the gripper. ${by}.`;
  byId<HTMLInputElement>('voxels').disabled = depths.length === 0;
}

function showPicture({ rgb, width, height }: Picture): void {
  const canvas = byId<HTMLCanvasElement>('picture');
  canvas.width = width;
  canvas.height = height;
  const rgba = new Uint8ClampedArray(4 * width * height).fill(255);
  for (let pixel = 0; pixel < width * height; pixel++) rgba.set(rgb.subarray(3 * pixel, 3 * pixel + 3), 4 * pixel);
  canvas.getContext('2d')?.putImageData(new ImageData(rgba, width, height), 0, 0);
}

function showProvenance({ command, commit, poses, episodes, successes, wilson95 }: Agent): void {
  const [low, high] = wilson95.map((share) => Math.round(100 * share));
  const whose = poses === 'learned' ? 'its own poses' : "the demonstrator's poses";
  byId('provenance').textContent =
    `Weights of "${command}" at ${commit}: ${successes} of ${episodes} held-out scenes (95 % interval ${low} to ${high} %) with ${whose}. ` +
    'Scenes 5000 to 5099 are those.';
}

/** Emphasises a candidate and lets a ghost of the arm follow it. */
async function point(candidate: number | null): Promise<void> {
  const { plan } = state;
  if (!plan || state.phase !== 'ready') return;
  const pointed = candidate ?? state.selected;
  view.setEmphasis(plan, { winner: plan.chosen, pointed });
  if (pointed === null) return view.setGhost(undefined);
  const poses = await engine.call('ghost', pointed);
  if (state.plan === plan && state.phase === 'ready') view.setGhost(poses);
}

function select(candidate: number): void {
  state.selected = state.selected === candidate ? null : candidate;
  markSelected(byId('candidates'), state.selected);
  setPhase(state.phase);
  void point(state.selected);
}

/** Executes a candidate, then plans the next step unless the episode is over. */
async function run(candidate: number | null | undefined): Promise<void> {
  const { plan: chosenFrom } = state;
  if (candidate == null || !chosenFrom || state.phase !== 'ready') return;
  setPhase('running');
  const mine = era;
  const executed = await engine.call('execute', candidate);
  if (mine !== era) return;
  view.clearPlan();
  await view.play(executed.poses, executed.outcome.frame_seconds);
  if (mine !== era) return;
  showOutcome(executed);
  if (executed.outcome.ended) return setPhase('ended');
  await plan();
}

async function runEpisode(): Promise<void> {
  const mine = era;
  while (mine === era && state.phase === 'ready') await run(state.plan?.chosen);
}

function showOutcome({ outcome, poses, milliseconds }: Executed): void {
  state.outcomes.push(outcome);
  const nFrames = poses.length / 7 / (state.scene?.items.length ?? 1);
  const simulated = nFrames * outcome.frame_seconds;
  const box = byId('outcome');
  box.className = outcome.reward > 0 ? 'success' : outcome.ended ? 'failed' : '';
  box.textContent = outcomeText(outcome);
  byId('timings').textContent = `${simulated.toFixed(1)} s simulated in ${milliseconds.toFixed(0)} ms; world ${outcome.world_hash}.`;
}

function outcomeText({ reward, ended, invalid, step }: Outcome): string {
  if (reward > 0) return `Success: reward 1 after ${step + 1} steps.`;
  if (invalid) return `Failed in step ${step + 1}: ${invalid}.`;
  return ended ? `Failed: the task is not done after ${step + 1} steps.` : `Step ${step + 1} done, no reward yet.`;
}

async function start(): Promise<void> {
  agents = (await (await fetch('weights/index.json')).json()) as Agent[];
  const select = byId<HTMLSelectElement>('task');
  for (const { task, poses } of agents) select.add(new Option(poses === 'learned' ? task : `${task} (demonstrator's poses)`, task));
  const link = new URLSearchParams(location.hash.slice(1));
  const linked = Number(link.get('seed') ?? DEFAULT_SEED);
  byId<HTMLInputElement>('seed').value = String(Number.isInteger(linked) && linked >= 0 && linked < 2 ** 32 ? linked : DEFAULT_SEED);
  if (agents.some(({ task }) => task === link.get('task'))) select.value = link.get('task')!;
  await loadAgent();
}

function paintLegend(): void {
  const stops = Array.from({ length: 9 }, (_, idx) => css(viridis(idx / 8)));
  byId('legend').querySelector('i')!.style.background = `linear-gradient(to right, ${stops.join(', ')})`;
}

byId('scene-form').addEventListener('submit', (event) => {
  event.preventDefault();
  void reset();
});
byId('next-scene').addEventListener('click', () => {
  if (!byId<HTMLFormElement>('scene-form').reportValidity()) return;
  byId<HTMLInputElement>('seed').valueAsNumber = (seed() + 1) % 2 ** 32;
  void reset();
});
byId('task').addEventListener('change', () => {
  if (byId<HTMLFormElement>('scene-form').reportValidity()) void loadAgent();
});
byId('voxels').addEventListener('change', () => view.showAttention(byId<HTMLInputElement>('voxels').checked));
byId('run-winner').addEventListener('click', () => void inEra(() => run(state.plan?.chosen)));
byId('run-selected').addEventListener('click', () => void inEra(() => run(state.selected)));
byId('run-episode').addEventListener('click', () => void inEra(runEpisode));
byId('restart').addEventListener('click', () => {
  engine.stop();
  engine = newEngine();
  byId('failure').hidden = true;
  void loadAgent();
});

/** What the page shows, for tests. */
Object.assign(window, { __lpr: { snapshot: () => ({ ...state, jobs: jobs.snapshot() }) } });

paintLegend();
start().catch(fail);
void jobs.start();
