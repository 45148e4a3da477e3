/** The training jobs of the server that the page came from, with a live curve of one of them. */

import uPlot from 'uplot';
import 'uplot/dist/uPlot.min.css';
import { byId } from './page';

/** Milliseconds between two looks at the list. */
const LIST_INTERVAL = 4000;
/** Jobs listed. */
const LIMIT = 20;
/** What the curve shows, by the metric's name. */
const CURVES = [
  { metric: 'validation/success_rate', label: 'validation success', color: '#0b7285', points: true },
  { metric: 'episode/success', label: 'training success, mean of 20 episodes', color: '#e8590c', points: false },
] as const;
/** Episodes of which the training success is the mean. */
const WINDOW = 20;

interface Job {
  id: string;
  state: string;
  message: string | null;
  spec: { task: string; method: string };
  created_at: string;
  env_steps: number | null;
  success_rate: number | null;
}

type Point = Record<string, number | null>;

export class Jobs {
  private shown: string | undefined;
  private stream: EventSource | undefined;
  private hasEnded = false;
  private points: Point[] = [];
  private plot: uPlot | undefined;

  /** Looks for a server, and goes on looking at its list. Without one the page is whole but for this panel. */
  async start(): Promise<void> {
    const found = await this.refresh();
    if (found) setInterval(() => void this.refresh(), LIST_INTERVAL);
  }

  private async refresh(): Promise<boolean> {
    if (document.hidden && this.shown) return true;
    const jobs = await fetchJobs();
    if (!jobs) {
      say('No server answers here: everything else on this page works without one. Start one with: lpr serve');
      return false;
    }
    say(jobs.length === 0 ? 'None yet. Submit one with POST /v1/jobs, see /openapi.json.' : '');
    byId('jobs').hidden = jobs.length === 0;
    byId('job-rows').replaceChildren(...jobs.map((job) => this.row(job)));
    const first = jobs.find(({ state }) => state === 'running') ?? jobs[0];
    if (!this.shown && first) this.show(first);
    return true;
  }

  private row(job: Job): HTMLTableRowElement {
    const row = document.createElement('tr');
    const success = job.success_rate === null ? '–' : `${Math.round(100 * job.success_rate)} %`;
    const submitted = new Date(job.created_at).toLocaleString();
    for (const text of [job.spec.task, job.spec.method, job.state, String(job.env_steps ?? '–'), success, submitted]) {
      row.insertCell().textContent = text;
    }
    row.cells[2]!.className = `state ${job.state}`;
    if (job.message) row.cells[2]!.title = job.message;
    row.tabIndex = 0;
    row.setAttribute('aria-selected', String(job.id === this.shown));
    row.addEventListener('click', () => this.show(job));
    row.addEventListener('keydown', (event) => event.key === 'Enter' && this.show(job));
    return row;
  }

  /** Follows the metrics of a job from its beginning. */
  private show(job: Job): void {
    this.stream?.close();
    this.hasEnded = false;
    this.shown = job.id;
    this.points = [];
    byId('curve-title').textContent = `${job.spec.task}, ${job.spec.method}: success over environment steps`;
    byId('curve-figure').hidden = false;
    this.stream = new EventSource(`v1/jobs/${encodeURIComponent(job.id)}/events`);
    this.stream.addEventListener('metric', ({ data }: MessageEvent<string>) => {
      this.points.push(JSON.parse(data) as Point);
      this.drawSoon();
    });
    this.stream.addEventListener('rewind', ({ data }: MessageEvent<string>) => {
      // A worker was lost: its job goes on from a checkpoint, before the points after it.
      this.points.length = Math.min(this.points.length, (JSON.parse(data) as { points: number }).points);
      this.drawSoon();
    });
    this.stream.addEventListener('end', () => {
      this.hasEnded = true;
      this.stream?.close();
    });
  }

  private asked = false;

  private drawSoon(): void {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.asked = false;
      this.plot ??= this.newPlot();
      this.plot.setData(curves(this.points));
    });
  }

  private newPlot(): uPlot {
    const box = byId('curve');
    const size = () => ({ width: Math.max(box.clientWidth, 240), height: 190 });
    const series = CURVES.map(({ label, color, points }) => ({
      label,
      stroke: color,
      width: 2,
      spanGaps: true,
      points: { show: points, size: 7, fill: color },
      value: (_: uPlot, value: number | null) => (value === null ? '–' : `${Math.round(100 * value)} %`),
    }));
    const percent = (_: uPlot, ticks: number[]) => ticks.map((tick) => `${Math.round(100 * tick)} %`);
    const options: uPlot.Options = {
      ...size(),
      scales: { x: { time: false }, y: { range: [0, 1.02] } },
      axes: [{}, { values: percent, size: 60 }],
      series: [{ label: 'step' }, ...series],
    };
    const plot = new uPlot(options, [[]], box);
    new ResizeObserver(() => plot.setSize(size())).observe(box);
    return plot;
  }

  /** What is shown, for tests. */
  snapshot(): { job: string | undefined; points: Point[]; hasEnded: boolean } {
    return { job: this.shown, points: this.points, hasEnded: this.hasEnded };
  }
}

/** The columns of the plot: environment steps, then each curve. */
function curves(points: Point[]): uPlot.AlignedData {
  const recent: number[] = [];
  const rows = points.map((point) => {
    const episode = point['episode/success'] ?? null;
    if (episode !== null) recent.push(episode);
    if (recent.length > WINDOW) recent.shift();
    const mean = recent.reduce((sum, success) => sum + success, 0) / recent.length;
    return [point['env_steps'] ?? 0, point['validation/success_rate'] ?? null, episode === null ? null : mean] as const;
  });
  return [rows.map(([x]) => x), rows.map(([, validation]) => validation), rows.map(([, , training]) => training)];
}

async function fetchJobs(): Promise<Job[] | undefined> {
  try {
    const response = await fetch(`v1/jobs?limit=${LIMIT}`, { headers: { accept: 'application/json' } });
    if (!response.ok) return undefined;
    return ((await response.json()) as { jobs: Job[] }).jobs;
  } catch {
    return undefined;
  }
}

function say(text: string): void {
  byId('server-status').textContent = text;
}
