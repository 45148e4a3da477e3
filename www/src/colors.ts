/** Colours of values: viridis, which also those read who do not tell red from green. */

/** Viridis at equal distances, sRGB. */
const VIRIDIS = ['#440154', '#482878', '#3e4989', '#31688e', '#26828e', '#1f9e89', '#35b779', '#6ece58', '#b5de2b', '#fde725'];

function channels(hex: string): [number, number, number] {
  return [1, 3, 5].map((start) => parseInt(hex.slice(start, start + 2), 16) / 255) as [number, number, number];
}

/** The colour of `fraction`, 0 to 1, as sRGB channels of 0 to 1. */
export function viridis(fraction: number): [number, number, number] {
  const place = Math.min(Math.max(fraction, 0), 1) * (VIRIDIS.length - 1);
  const below = Math.min(Math.floor(place), VIRIDIS.length - 2);
  const [from, to] = [channels(VIRIDIS[below]!), channels(VIRIDIS[below + 1]!)];
  return from.map((channel, idx) => channel + (to[idx]! - channel) * (place - below)) as [number, number, number];
}

export function css(rgb: [number, number, number]): string {
  return `rgb(${rgb.map((channel) => Math.round(channel * 255)).join(' ')})`;
}

/** Maps values to 0 to 1 within the range that they span. */
export function scale(values: number[]): (value: number) => number {
  const [low, high] = [Math.min(...values), Math.max(...values)];
  return (value) => (high > low ? (value - low) / (high - low) : 1);
}
