// The page of the real daemon with the simulated wagon of the demo.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Served, isLive, launchBrowser, openPage, text, until, verdict } from './support.mjs';

test('shows the simulated wagon live', { timeout: 240000 }, async (t) => {
  const daemon = await Served.start(process.env.WAGONSIGHTD, ['--config', process.env.WAGONSIGHT_DEMO_CONFIG, '--port', '0']);
  t.after(() => daemon.end());
  const browser = await launchBrowser();
  t.after(() => browser.close());
  const page = await openPage(browser, daemon.url);
  await isLive(page);
  await until(async () => await page.locator('#sensors tr').count() === 4, 'four sensors');
  assert.equal(await page.locator('.s-sensor').count(), 4);
  assert.ok(await page.locator('.s-seat').count() > 0);
  assert.ok(await page.locator('#simulated').isVisible());
  const framesets = async () => (await (await fetch(daemon.url + 'api/v1/pipeline')).json()).framesets;
  const before = await framesets();
  await until(async () => await framesets() > before + 30, 'frames that are worked on');
  await until(async () => ['ok', 'degraded'].includes(await verdict(page)), 'a verdict that is no failure');
  assert.notEqual(await text(page, '#cal-source'), 'none');
  assert.deepEqual(page.complaints, []);
  assert.deepEqual(page.foreign, []);
  daemon.child.kill('SIGTERM');
  await until(() => daemon.child.exitCode !== null, 'the end of the daemon');
  assert.equal(daemon.child.exitCode, 0);
});
