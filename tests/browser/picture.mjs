// node picture.mjs URL OUT.png [desktop|phone] [light|dark] [SECONDS]   takes a picture of a running page.
import { launchBrowser } from './support.mjs';

const [url, out, device = 'desktop', colorScheme = 'light', seconds = '8'] = process.argv.slice(2);
if (!out) {
  console.error('usage: node picture.mjs URL OUT.png [desktop|phone] [light|dark] [SECONDS]');
  process.exit(2);
}
const browser = await launchBrowser();
const phone = device === 'phone';
const context = await browser.newContext({
  viewport: phone ? { width: 390, height: 844 } : { width: 1280, height: 900 },
  deviceScaleFactor: 2, isMobile: phone, colorScheme,
});
const page = await context.newPage();
await page.goto(url);
await page.waitForTimeout(1000 * Number(seconds));
await page.screenshot({ path: out, fullPage: true });
await browser.close();
