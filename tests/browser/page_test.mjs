// The page in a real browser, fed by page_feed: what it shows, and what it does when things break.
import assert from 'node:assert/strict';
import { after, before, beforeEach, afterEach, test } from 'node:test';
import { Served, isLive, launchBrowser, link, openPage, text, until, verdict } from './support.mjs';

const FEED = process.env.WAGONSIGHT_PAGE_FEED;
let browser, feed, page;

before(async () => { browser = await launchBrowser(); });
after(async () => { await browser?.close(); });
beforeEach(async () => { feed = await Served.start(FEED); });
afterEach(async () => {
  await page?.context().close();
  page = undefined;
  await feed.end();
});

async function open(options) {
  page = await openPage(browser, feed.url, options);
  await isLive(page);
  await until(async () => await page.locator('.s-person').count() === 5, 'five people on the plan');
}

test('tells the verdict first, in plain words', async () => {
  await open();
  assert.equal(await text(page, 'h1'), 'All is well');
  assert.equal(await text(page, '#sentence'), '4 sensors watch the wagon; 5 people are inside.');
  const above = await page.evaluate(() => document.querySelector('.verdict').getBoundingClientRect().bottom
    <= document.querySelector('.plan').getBoundingClientRect().top);
  assert.ok(above, 'the verdict stands above everything else');
});

test('shows people who move, with height and posture', async () => {
  await open();
  const place = () => page.locator('.s-person[data-person="1"]').getAttribute('transform');
  const first = await place();
  await until(async () => await place() !== first, 'person 1 at another place');
  assert.match(await text(page, '#people tr:nth-child(1)'), /standing\s+1\.78 m/);
  assert.match(await text(page, '#people tr:nth-child(2)'), /sitting\s+1\.66 m/);
  assert.ok(await page.locator('.s-person[data-person="1"] .arrow').getAttribute('d'), 'a walker has an arrow');
  assert.ok(await page.locator('.s-trail').first().getAttribute('d'), 'and a trail');
});

test('counts zones, seats and doors as the unit does', async () => {
  await open();
  // The walker changes zones, so page and unit are compared until both were read within one second.
  await until(async () => {
    const told = await (await fetch(feed.url + 'api/v1/occupancy')).json();
    const shown = await page.locator('#zones li').allInnerTexts();
    return told.zones.every((zone, i) => shown[i].replace(/\s+/g, ' ') === `${zone.name} ${zone.count} of ${zone.capacity}`);
  }, 'the same zone counts');
  assert.equal(await text(page, '#count'), '5');
  assert.equal(await text(page, '#seats'), '2 of 10, 1 not seen');
  assert.equal(await page.locator('.s-seat.occupied').count(), 2);
  assert.match(await text(page, '#counts'), /door A\s+6 in, 2 out/);
});

test('asks nobody else for anything and has nothing to complain about', async () => {
  await open();
  await page.waitForTimeout(1500);
  assert.deepEqual(page.foreign, []);
  assert.deepEqual(page.complaints, []);
});

test('does not jump while it loads and lives', async () => {
  await page?.context().close();
  page = await openPage(browser, feed.url);
  const shift = await page.evaluate(() => new Promise((done) => {
    let sum = 0;
    new PerformanceObserver((list) => list.getEntries().forEach((entry) => { sum += entry.value; }))
      .observe({ type: 'layout-shift', buffered: true });
    setTimeout(() => done(sum), 3000);
  }));
  assert.ok(shift < 0.1, `layout shift ${shift} (0.1 is what counts as good)`);
});

for (const width of [390, 320]) {
  test(`fits a phone of ${width} pixels`, async () => {
    await open({ viewport: { width, height: 844 }, isMobile: true, hasTouch: true });
    const wide = await page.evaluate(() => document.documentElement.scrollWidth);
    assert.ok(wide <= width, `the page is ${wide} pixels wide`);
    const plan = await page.locator('#plan').boundingBox();
    assert.ok(plan.height > plan.width, 'the wagon stands upright on a phone');
    const outside = await page.evaluate(() => [...document.querySelectorAll('.s-person')].filter((figure) => {
      const box = figure.querySelector('.body').getBoundingClientRect();
      const stage = document.getElementById('stage').getBoundingClientRect();
      return box.left < stage.left || box.right > stage.right;
    }).length);
    assert.equal(outside, 0);
  });
}

test('follows the light or dark of the system', async () => {
  await open({ colorScheme: 'dark' });
  const ground = () => page.evaluate(() => getComputedStyle(document.body).backgroundColor);
  const dark = await ground();
  await page.emulateMedia({ colorScheme: 'light' });
  assert.notEqual(await ground(), dark);
});

test('names a lost sensor, and what to do about it', async () => {
  await open();
  feed.say('lose k2');
  await until(async () => await verdict(page) === 'degraded', 'a degraded verdict');
  assert.equal(await text(page, 'h1'), 'Works, with limits');
  assert.match(await text(page, '#faults'), /Sensor k2 has been silent/);
  assert.match(await text(page, '#faults'), /Check the cable and the power of k2/);
  assert.match(await text(page, '#sensors tr:nth-child(3)'), /lost/);
  feed.say('find k2');
  await until(async () => await verdict(page) === 'ok', 'all well again');
});

test('shows an event with its evidence', async () => {
  await open();
  assert.match(await text(page, '#events'), /Nothing to report/);
  feed.say('fall');
  await until(async () => /Fall, person 3/.test(await text(page, '#events')), 'the fall');
  assert.match(await text(page, '#events'), /standing to lying within 0\.7 s/);
  await until(async () => await page.locator('.s-person.alarm[data-person="3"]').count() === 1, 'the alarm on the plan');
  feed.say('rise');
  await until(async () => await page.locator('#events li.over').count() === 1, 'the end of the event');
});

test('says that it is stale when the unit stops publishing, and goes on after', async () => {
  await open();
  feed.say('pause');
  await until(async () => await link(page) === 'stale', 'a stale page');
  assert.match(await text(page, '#veil'), /published nothing for/);
  await until(async () => await verdict(page) === 'failed', 'a failed verdict');
  feed.say('resume');
  await isLive(page);
  assert.ok(await page.locator('#veil').isHidden());
});

test('survives the death of the web side', async () => {
  await open();
  const before = await page.evaluate(() => performance.timeOrigin);
  feed.say('kill');
  await until(async () => (await (await fetch(feed.url + 'api/v1/log').catch(() => new Response('{}'))).text()).includes('signal 9'),
    'the web side back');
  await until(async () => {
    const place = () => page.locator('.s-person[data-person="1"]').getAttribute('transform');
    const first = await place();
    await page.waitForTimeout(400);
    return await place() !== first;
  }, 'people who move again');
  assert.equal(await page.evaluate(() => performance.timeOrigin), before, 'without being loaded anew');
});

test('survives the death of the daemon', async () => {
  await open();
  await feed.end();
  await until(async () => await link(page) === 'lost', 'a lost link');
  assert.equal(await text(page, 'h1'), 'No link to the unit');
  assert.ok(await page.locator('#veil').isVisible());
  feed = await Served.start(FEED, [feed.port]);
  await isLive(page);
  await until(async () => await verdict(page) === 'ok', 'the verdict');
});

test('can be used by keyboard and read aloud', async () => {
  await open();
  await page.locator('#people button').first().focus();
  await page.keyboard.press('Enter');
  assert.equal(await page.locator('#people button').first().getAttribute('aria-pressed'), 'true');
  assert.equal(await page.locator('.s-person.chosen').count(), 1);
  await until(async () => /^Plan of the wagon: 5 people: \d in front/.test(await page.locator('#plan').getAttribute('aria-label')), 'the plan in words');
  const nameless = await page.evaluate(() => [...document.querySelectorAll('button, a, input, [role=region], section')]
    .filter((node) => !(node.innerText || node.getAttribute('aria-label') || node.labels?.length || node.getAttribute('aria-labelledby'))).length);
  assert.equal(nameless, 0, 'everything that can be reached has a name');
});

test('shows counts without a token, and people with it', async () => {
  await feed.end();
  feed = await Served.start(FEED, [], { WAGONSIGHT_FEED_TOKEN: 'the token of this test' });
  page = await openPage(browser, feed.url);
  await isLive(page);
  await until(async () => await text(page, '#count') === '5', 'the count');
  assert.ok(await page.locator('#signin').isVisible());
  assert.equal(await page.locator('.s-person').count(), 0);
  await page.fill('#token', 'not the token');
  await page.click('#signin button');
  await until(async () => /Bearer/.test(await text(page, '#signin-error')), 'why it was refused');
  await page.fill('#token', 'the token of this test');
  await page.click('#signin button');
  await until(async () => await page.locator('.s-person').count() === 5, 'the people');
  assert.equal(await page.evaluate(() => document.cookie), '', 'scripts cannot read the cookie');
  await page.reload();
  await until(async () => await page.locator('.s-person').count() === 5, 'the people, still');
});
