// Checks models that `lightsum bake` wrote, as clients see them: node check.mjs FOLDER CHROMIUM
//
// FOLDER holds node_modules, room.glb (unlit), lit.glb and own.png, the image of room.glb by lightsum.

import { spawn } from 'node:child_process';
import { createRequire } from 'node:module';
import { createServer } from 'node:http';
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { extname, join, normalize, resolve } from 'node:path';

/** Greatest mean difference of a channel, of 1: that of 8-bit textures, and of edges, which each program smooths in its own way. */
const MAX_MEAN = 0.01;
/** Greatest part of the pixels with a channel that differs by more than 0.1. */
const MAX_APART = 0.02;
/** Seconds in which the browser must answer: it renders without a graphics card. */
const PATIENCE = 120;

const [folder, chromium] = [resolve(process.argv[2]), process.argv[3]];
const validator = createRequire(join(folder, 'package.json'))('gltf-validator');
let failed = false;
const check = (good, text) => {
  failed ||= !good;
  console.log(`${good ? 'ok  ' : 'FAIL'} ${text}`);
};

for (const name of ['room.glb', 'lit.glb']) {
  const { issues } = await validator.validateBytes(new Uint8Array(readFileSync(join(folder, name))));
  const first = issues.messages.filter((issue) => issue.severity < 2).slice(0, 3).map((issue) => `${issue.code} at ${issue.pointer}`);
  check(issues.numErrors === 0, `${name}: ${issues.numErrors} errors, ${issues.numWarnings} warnings ${first.join('; ')}`);
}

const types = { '.html': 'text/html', '.js': 'text/javascript', '.png': 'image/png', '.glb': 'model/gltf-binary' };
let answer;
const answered = new Promise((done) => (answer = done));
const server = createServer((request, response) => {
  if (request.method === 'POST') {
    let body = '';
    request.on('data', (part) => (body += part));
    request.on('end', () => {
      response.end();
      answer(JSON.parse(body));
    });
    return;
  }
  const path = normalize(new URL(request.url, 'http://localhost').pathname);
  const from = path === '/room.html' ? import.meta.dirname : path.startsWith('/three/') ? join(folder, 'node_modules') : folder;
  try {
    const bytes = readFileSync(join(from, path));
    response.writeHead(200, { 'content-type': types[extname(path)] ?? 'application/octet-stream' }).end(bytes);
  } catch {
    response.writeHead(404).end();
  }
});
await new Promise((listening) => server.listen(0, '127.0.0.1', listening));

const profile = mkdtempSync(join(tmpdir(), 'lightsum-web-'));
const flags = ['--headless', '--no-sandbox', '--disable-gpu-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--ignore-gpu-blocklist'];
const address = `http://127.0.0.1:${server.address().port}/room.html`;
const browser = spawn(chromium, [...flags, `--user-data-dir=${profile}`, '--remote-debugging-port=0', address], { stdio: 'ignore' });
const gone = new Promise((done) => browser.on('exit', done));
browser.on('error', (error) => answer({ error: `${chromium}: ${error.message}` }));
const silence = setTimeout(() => answer({ error: `no answer from ${chromium} within ${PATIENCE} seconds` }), PATIENCE * 1000);
const result = await answered;
clearTimeout(silence);
browser.kill();
await Promise.race([gone, new Promise((done) => setTimeout(done, 5000))]);
rmSync(profile, { recursive: true, force: true, maxRetries: 5 });
server.close();

if (result.error) {
  check(false, `three.js: ${result.error}`);
} else {
  writeFileSync(join(folder, 'shown.png'), Buffer.from(result.image.split(',')[1], 'base64'));
  const { mean, apart, covered } = result;
  check(covered > 0.3, `three.js: ${(100 * covered).toFixed(0)} % of the pixels show the room`);
  check(mean <= MAX_MEAN, `three.js: mean difference ${mean.toFixed(4)} of at most ${MAX_MEAN}`);
  check(apart <= MAX_APART, `three.js: ${(100 * apart).toFixed(2)} % of the pixels differ by more than a tenth, of at most ${100 * MAX_APART} %`);
}
process.exit(failed ? 1 : 0);
