// viewer.mjs MODULES CAMERAS INDEX (VIEWER MODEL OUT.png)... - has viewer.html draw models in a headless Chromium.
//
// MODULES is the folder node_modules that holds puppeteer-core and the viewers; CAMERAS a cameras.json. Prints what each viewer
// read, as JSON, a line each. The environment's SPLATFIT_CHROMIUM names the browser.
import { createReadStream, existsSync, readFileSync, writeFileSync } from 'node:fs';
import { createServer } from 'node:http';
import { createRequire } from 'node:module';
import { extname, join, resolve } from 'node:path';
import { fileURLToPath } from 'node:url';

const [modules, cameras, index, ...jobs] = process.argv.slice(2);
const puppeteer = createRequire(join(resolve(modules), 'x.js'))('puppeteer-core');
const view = JSON.parse(readFileSync(cameras))[Number(index)];
const TYPES = { '.html': 'text/html', '.js': 'text/javascript', '.json': 'application/json', '.wasm': 'application/wasm' };
const PATIENCE = 120000; // ms; a loaded machine draws slowly without a GPU
let model = '';

// The page, the viewers' files, and the model: on this machine alone.
const server = createServer((request, response) => {
  const path = decodeURIComponent(new URL(request.url, 'http://x').pathname);
  const file = path === '/' ? fileURLToPath(new URL('viewer.html', import.meta.url))
    : path.startsWith('/model.') ? model
      : path.startsWith('/modules/') && !path.includes('..') ? join(modules, path.slice(9)) : null;
  if (!file || !existsSync(file)) return response.writeHead(404).end();
  response.writeHead(200, { 'Content-Type': TYPES[extname(file)] || 'application/octet-stream' });
  createReadStream(file).pipe(response);
});
await new Promise(done => server.listen(0, '127.0.0.1', done));

const browser = await puppeteer.launch({
  executablePath: process.env.SPLATFIT_CHROMIUM || ['/usr/bin/chromium', '/usr/bin/chromium-browser'].find(existsSync),
  headless: true, pipe: true, protocolTimeout: PATIENCE, timeout: PATIENCE,
  args: ['--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--no-proxy-server', '--disable-dev-shm-usage',
    '--hide-scrollbars'],
});

async function draw(viewer, out) {
  const page = await browser.newPage();
  page.on('pageerror', error => console.error(String(error)));
  await page.setViewport({ width: view.width, height: view.height, deviceScaleFactor: 1 });
  await page.goto(`http://127.0.0.1:${server.address().port}/`, { timeout: PATIENCE });
  await page.waitForFunction('window.ready', { timeout: PATIENCE });
  const read = await page.evaluate((...all) => window.show(...all), viewer, `model${extname(model)}`, view);
  writeFileSync(out, await (await page.$('canvas')).screenshot({ type: 'png' }));
  await page.close();
  console.log(JSON.stringify({ viewer, model: model.replace(/.*\//, ''), ...read }));
}

try {
  for (let i = 0; i + 2 < jobs.length; i += 3) {
    model = jobs[i + 1];
    await draw(jobs[i], jobs[i + 2]);
  }
} catch (error) {
  console.error(String(error.message || error));
  process.exitCode = 1;
} finally {
  await browser.close();
  server.close();
}
