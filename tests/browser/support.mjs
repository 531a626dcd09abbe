// What the page's tests have in common: a browser, a feed or a daemon, and patience.
import { spawn } from 'node:child_process';
import { once } from 'node:events';
import { chromium } from 'playwright-core';

export const CHROMIUM = process.env.WAGONSIGHT_CHROMIUM || '/usr/bin/chromium';
const PATIENCE_MS = 60000;

export function launchBrowser() {
  return chromium.launch({
    executablePath: CHROMIUM,
    args: ['--headless', '--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run',
      '--disable-background-networking', '--disable-component-update', '--disable-sync'],
  });
}

// A program that prints its address first. `say` writes a line to its stdin.
export class Served {
  static async start(program, args = [], env = {}) {
    const child = spawn(program, args, { env: { ...process.env, ...env }, stdio: ['pipe', 'pipe', 'ignore'] });
    let out = '';
    child.stdout.on('data', (part) => { out += part; });
    await until(() => out.includes('\n'), `the address of ${program}`);
    const served = new Served();
    served.child = child;
    served.url = out.split('\n')[0];
    served.port = new URL(served.url).port;
    return served;
  }
  say(line) { this.child.stdin.write(line + '\n'); }
  async end(signal = 'SIGKILL') {
    if (this.child.exitCode !== null || this.child.signalCode !== null) return;
    this.child.kill(signal);
    await once(this.child, 'exit');
  }
}

export async function until(condition, what) {
  const deadline = Date.now() + PATIENCE_MS;
  for (;;) {
    const value = await condition();
    if (value) return value;
    if (Date.now() > deadline) throw new Error(`did not come: ${what}`);
    await new Promise((done) => setTimeout(done, 50));
  }
}

// An open page that remembers everything it should not have said or asked for.
export async function openPage(browser, url, options = {}) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 900 }, ...options });
  const page = await context.newPage();
  page.setDefaultTimeout(PATIENCE_MS);
  page.complaints = [];
  page.foreign = [];
  page.on('console', (message) => { if (['error', 'warning'].includes(message.type())) page.complaints.push(message.text()); });
  page.on('pageerror', (error) => page.complaints.push(error.message));
  page.on('request', (request) => {
    if (!request.url().startsWith(url) && !request.url().startsWith('data:')) page.foreign.push(request.url());
  });
  await page.goto(url);
  return page;
}

export const text = (page, selector) => page.locator(selector).innerText();
export const link = (page) => page.evaluate(() => document.body.dataset.link);
export const verdict = (page) => page.evaluate(() => document.body.dataset.verdict);
export const isLive = (page) => until(async () => await link(page) === 'live', 'a live page');
