/** The table of candidates: the same that the 3D view shows as lines, for those who read rather than look. */

import { css } from './colors';
import type { Plan, Source } from './protocol';
import { candidateColors } from './view';

const NAMES: Record<Source, string> = { planner: 'planner', bezier: 'Bézier', policy: 'policy', linear: 'linear', screw: 'screw' };

/** Words for the reasons why a draw gives no path. */
const REASONS: Record<string, string> = {
  unreachable: 'pose out of reach',
  curve_unreachable: 'curve out of reach',
  branch_jump: 'posture would jump',
  start_collides: 'start touches the scene',
  goal_collides: 'goal touches the scene',
  iteration_limit: 'planner gave up',
  too_few_goals: 'no further posture',
  longer_than_mean: 'longer than the mean',
  outside_limits: 'outside joint limits',
};

export interface TableEvents {
  /** The pointer or the focus is on a candidate, or on none. */
  point: (candidate: number | null) => void;
  select: (candidate: number) => void;
}

/** Indices of the candidates, the highest value first. */
export function ranking({ candidates }: Plan): number[] {
  const value = (idx: number) => candidates[idx]!.value ?? -Infinity;
  return candidates.map((_, idx) => idx).sort((a, b) => value(b) - value(a) || a - b);
}

/** Fills `body` with a row for each candidate. */
export function fillTable(body: HTMLElement, plan: Plan, events: TableEvents): void {
  const colorOf = candidateColors(plan);
  const rows = ranking(plan).map((idx, rank) => {
    const row = candidateRow(plan, idx, rank, css(colorOf(idx)));
    row.addEventListener('pointerenter', () => events.point(idx));
    row.addEventListener('focus', () => events.point(idx));
    row.addEventListener('click', () => events.select(idx));
    row.addEventListener('keydown', (event) => {
      if (event.key === 'Enter' || event.key === ' ') {
        event.preventDefault();
        events.select(idx);
      } else if (event.key === 'ArrowDown' || event.key === 'ArrowUp') {
        event.preventDefault();
        const next = event.key === 'ArrowDown' ? row.nextElementSibling : row.previousElementSibling;
        (next as HTMLElement | null)?.focus();
      }
    });
    return row;
  });
  body.onpointerleave = () => events.point(null);
  body.replaceChildren(...rows);
}

/** Marks the selected row. */
export function markSelected(body: HTMLElement, candidate: number | null): void {
  for (const row of body.querySelectorAll<HTMLElement>('tr')) {
    row.setAttribute('aria-selected', String(row.dataset.candidate === String(candidate)));
  }
}

function candidateRow(plan: Plan, idx: number, rank: number, color: string): HTMLTableRowElement {
  const candidate = plan.candidates[idx]!;
  const row = document.createElement('tr');
  row.tabIndex = 0;
  row.dataset.candidate = String(idx);
  row.setAttribute('aria-selected', 'false');
  if (idx === plan.chosen) row.classList.add('winner');
  const value = cell(candidate.value === null ? '–' : candidate.value.toFixed(3), 'number');
  const swatch = document.createElement('i');
  swatch.style.background = color;
  value.prepend(swatch);
  row.append(
    cell(String(rank + 1), 'number'),
    cell(NAMES[candidate.source], candidate.source),
    value,
    cell(`${candidate.length.toFixed(2)} rad`, 'number'),
    cell(candidate.collides ? 'touches' : 'free', candidate.collides ? 'touches' : ''),
  );
  return row;
}

function cell(text: string, className: string): HTMLTableCellElement {
  const cell = document.createElement('td');
  cell.textContent = text;
  cell.className = className;
  return cell;
}

/** Why there are not more candidates. */
export function rejectedText({ rejected }: Plan): string {
  if (rejected.length === 0) return 'No draw was rejected.';
  const counts = rejected.map(({ source, reason, count }) => `${count} × ${NAMES[source]}: ${REASONS[reason] ?? reason}`);
  return `Rejected draws: ${counts.join(', ')}.`;
}

/** Why the winner wins, in one sentence. */
export function whyText(plan: Plan): string {
  const order = ranking(plan);
  const winner = plan.chosen === null ? undefined : plan.candidates[plan.chosen];
  if (!winner) return 'No path reaches this pose, so the episode ends here.';
  if (winner.value === null) return `The ${NAMES[winner.source]} path runs; this agent has no ranker.`;
  const shortest = order.reduce((best, idx) => (plan.candidates[idx]!.length < plan.candidates[best]!.length ? idx : best), order[0]!);
  const place = order.indexOf(shortest) + 1;
  const second = plan.candidates[order[1] ?? order[0]!]!.value ?? winner.value;
  const ofShortest = place === 1 ? 'It is also the shortest.' : `The shortest path ranks ${place} of ${order.length}.`;
  return `A ${NAMES[winner.source]} path wins with ${winner.value.toFixed(3)}, ${(winner.value - second).toFixed(3)} ahead of the next. ${ofShortest}`;
}
