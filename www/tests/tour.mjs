// Visits the page in headless Chromium as a visitor would and prints one JSON object of what it saw.
//
// Usage: node tests/tour.mjs URL [DIRECTORY for screenshots]. CHROMIUM names the browser, /usr/bin/chromium without it.

import { chromium } from 'playwright-core';

const [url, screenshots] = process.argv.slice(2);
/** Milliseconds for what may take long on a busy machine that draws without a graphics card. */
const PATIENCE = 150_000;

const FLAGS = [
  '--headless=new',
  '--no-sandbox',
  '--disable-gpu',
  '--use-angle=swiftshader',
  '--enable-unsafe-swiftshader',
  '--disable-background-networking',
  '--disable-component-update',
  '--disable-sync',
  '--no-first-run',
];

const browser = await chromium.launch({ executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium', args: FLAGS });
const page = await browser.newPage({ viewport: { width: 1280, height: 800 } });
page.setDefaultTimeout(PATIENCE);

const complaints = [];
const transferred = {};
page.on('console', (message) => {
  if (message.type() === 'error') complaints.push(`${message.type()}: ${message.text()}`);
});
page.on('pageerror', (error) => complaints.push(`uncaught: ${error.message}`));
page.on('requestfinished', async (request) => {
  const { responseBodySize } = await request.sizes();
  transferred[new URL(request.url()).pathname] = responseBodySize;
});

const snapshot = () => page.evaluate(() => JSON.parse(JSON.stringify(window.__lpr.snapshot())));
const settled = (nOutcomes) =>
  page.waitForFunction(
    (expected) => {
      const { phase, outcomes } = window.__lpr.snapshot();
      return phase === 'failed' || (outcomes.length >= expected && (phase === 'ready' || phase === 'ended'));
    },
    nOutcomes,
    { polling: 100 },
  );
const picture = (name) => screenshots && page.screenshot({ path: `${screenshots}/${name}.png`, fullPage: true });
const table = () => page.$$eval('#candidates tr', (rows) => rows.map((row) => [...row.cells].map((cell) => cell.textContent)));

try {
  const begin = performance.now();
  await page.goto(url);
  await settled(0);
  const milliseconds_to_paths = performance.now() - begin;
  const first = await snapshot();
  const rows = await table();
  await picture('planned');

  // Hovering a row draws its path and a ghost of the arm.
  await page.hover('#candidates tr:nth-child(5)');
  await picture('pointed');
  if (await page.isEnabled('#voxels')) {
    await page.check('#voxels');
    await picture('voxels');
    await page.uncheck('#voxels');
  }

  const plans = [];
  let now = first;
  while (now.phase === 'ready') {
    plans.push(now.plan);
    await page.click('#run-winner');
    await settled(plans.length);
    now = await snapshot();
  }
  const outcome_text = await page.textContent('#outcome');
  await picture('ended');

  // The same scene once more begins with the same plan.
  await page.click('#scene-form button[type=submit]');
  await page.waitForFunction(() => window.__lpr.snapshot().phase === 'ready' && window.__lpr.snapshot().outcomes.length === 0);
  const again = await snapshot();

  // The curve of a job that has ended has all of its points.
  if (again.jobs.job) await page.waitForFunction(() => window.__lpr.snapshot().jobs.hasEnded);
  const job_points = (await snapshot()).jobs.points;
  await page.locator('#server').scrollIntoViewIfNeeded();
  await picture('jobs');

  const jobs = await page.$$eval('#job-rows tr', (rows) => rows.map((row) => [...row.cells].map((cell) => cell.textContent)));
  // Weights that do not come: the page says so, and starts again when it is told to.
  const unlucky = await browser.newPage();
  await unlucky.route('**/*.safetensors', (route) => route.abort());
  await unlucky.goto(url);
  await unlucky.waitForSelector('#failure', { timeout: PATIENCE });
  const failure_without_weights = await unlucky.textContent('#failure-text');
  await unlucky.unroute('**/*.safetensors');
  await unlucky.click('#restart');
  await unlucky.waitForFunction(() => window.__lpr.snapshot().phase === 'ready', null, { timeout: PATIENCE });

  const { phase, outcomes, scene } = now;
  const report = {
    milliseconds_to_paths,
    rows,
    scene: { task: scene.task, seed: scene.seed, robot: scene.robot },
    plans,
    phase,
    outcomes,
    outcome_text,
    same_plan_again: JSON.stringify(again.plan) === JSON.stringify(plans[0]),
    job_rows: jobs,
    job_points,
    failure: await page.textContent('#failure-text'),
    failure_without_weights,
    complaints,
    transferred,
  };
  console.log(JSON.stringify(report));
} finally {
  await browser.close();
}
