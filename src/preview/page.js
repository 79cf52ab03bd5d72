'use strict';
// page.js - asks the program what is new, shows it, and tells it which button was pressed.

const $ = id => document.getElementById(id);
const PART = 1 << 20; // bytes of a model fetched at a time
const newest = { session: null, camera: 0, render: 0, history: 0, model: 0 };
const busy = new Set();
const looks = { camera: true, render: true, viewer: true };
let coverageWanted = true; // laid over the camera's picture
let status = {}, lastAnswer = Date.now(), modelWas = 0, frames = [];

// ---- Asking ----

async function ask(path, limit, options = {}) {
  const answer = await fetch(path, { cache: 'no-store', credentials: 'same-origin', signal: AbortSignal.timeout(limit), ...options });
  if (answer.status === 403) throw Object.assign(new Error('403'), { refused: true });
  return answer;
}

// Once at a time; what fails is asked for again with the next status.
async function once(name, work) {
  if (busy.has(name)) return;
  busy.add(name);
  try {
    await work();
  } catch (e) {
    if (e instanceof TypeError || e.name === 'TimeoutError' || e.name === 'AbortError' || e.refused) return;
    console.error(e);
    if (name === 'model') note(e.message);
  } finally {
    busy.delete(name);
  }
}

function wanted() {
  if (document.hidden) return '';
  return (looks.camera ? 'c' : '') + (looks.camera && coverageWanted ? 'o' : '') + (looks.render ? 'r' : '') + (looks.viewer && view.gl && !busy.has('model') ? 'm' : '');
}

async function poll() {
  let pause = document.hidden || (status.still && newest.model) ? 3000 : 250;
  try {
    const answer = await ask(`status?want=${wanted()}`, 8000), all = await answer.json();
    lastAnswer = Date.now();
    offline(null);
    take(all);
  } catch (e) {
    pause = 1000;
    if (e.refused) offline('The program asks for another token: open the address that it shows.');
    else offline(`The program does not answer, for ${Math.round((Date.now() - lastAnswer) / 1000)} s; trying again.`);
  }
  setTimeout(poll, pause);
}

function offline(text) {
  $('offline').hidden = !text;
  $('offline').textContent = text || '';
  document.body.classList.toggle('offline', !!text);
  for (const button of $('buttons').children) button.disabled = !!text;
  if (text) showState('no answer', 'bad');
}

// ---- What is new ----

function take(all) {
  if (newest.session !== all.session) Object.assign(newest, { session: all.session, camera: 0, render: 0, history: -1, model: 0 });
  status = all.status;
  document.title = all.title ? `${all.title} - splatfit` : 'splatfit';
  $('title').textContent = all.title || 'splatfit';
  showStatus();
  for (const name of ['camera', 'render'])
    if (all[name] !== newest[name] && all[name] && !document.hidden) once(name, () => fetchPicture(name));
  // Coverage that came after its picture.
  if (all.camera === newest.camera && pictures.camera && coverageWanted && status.coverage) drawPicture('camera');
  if (all.history !== newest.history) once('history', fetchHistory);
  const m = all.model;
  if (m.version && m.version !== newest.model && view.gl && !document.hidden && Date.now() - modelWas > 500) once('model', () => fetchModel(m));
}

// The number of a version in an ETag "session-version".
const versionOf = answer => Number(/-(\d+)"$/.exec(answer.headers.get('ETag'))[1]);

async function fetchPicture(name) {
  const answer = await ask(`${name}.jpg`, 8000);
  if (!answer.ok) return;
  const picture = await createImageBitmap(await answer.blob());
  newest[name] = versionOf(answer);
  if (name === 'camera') frames = [...frames.filter(t => t > Date.now() - 4000), Date.now()];
  if (pictures[name]) pictures[name].close();
  pictures[name] = picture;
  drawPicture(name);
}

async function fetchHistory() {
  const { history, points } = await (await ask('history', 8000)).json();
  newest.history = history;
  chart.set(points);
}

// All `size` bytes of one version of a resource, part by part, of each of which `progress` is told; null: they are gone.
async function fetchParts(path, m, size, progress) {
  const bytes = new Uint8Array(size), tag = `"${newest.session}-${m.version}"`;
  for (let at = 0; at < size;) {
    const answer = await ask(path, 30000, { headers: { 'Range': `bytes=${at}-${Math.min(at + PART, size) - 1}`, 'If-Match': tag } });
    if (answer.status !== 206 && answer.status !== 200) return null;
    const part = new Uint8Array(await answer.arrayBuffer());
    if (!part.length || at + part.length > size) return null;
    bytes.set(part, at);
    at += part.length;
    progress(bytes.subarray(0, at));
  }
  return bytes;
}

// The first part shows most of the first model, for the Gaussians of most weight come first; later ones come whole.
async function fetchModel(m) {
  const size = m.count * SPLAT_BYTES, first = !view.count;
  const bytes = await fetchParts('model.splat', m, size, some => {
    if (first && (!view.count || (some.length === size && m.sh_degree))) showModel(some, m);
  });
  const sh = bytes && await fetchParts('model.sh', m, m.count * shBytes(m.sh_degree), () => {});
  if (!sh) return;
  newest.model = m.version;
  modelWas = Date.now();
  showModel(bytes, m, sh, m.sh_degree);
}

function showModel(bytes, m, sh, degree = 0) {
  view.set(bytes, m.antialiased, sh, degree);
  note(bytes.length ? '' : 'the model is empty');
  // Where the status says what the Gaussians stand for, that is said in place of how many they are.
  $('model-facts').textContent = status.contents || `${(bytes.length / SPLAT_BYTES).toLocaleString('en')} Gaussians${degree ? `, SH of degree ${degree}` : ''}`;
  if (view.count) orbit.frame(view.means);
  if (view.count && !placed) placed = firstView();
  $('to-model').disabled = !view.count;
}

// ---- The status ----

const fixed = digits => v => Number(v).toFixed(digits);
const whole = v => Math.round(v).toLocaleString('en');
const duration = v => v < 120 ? `${v.toFixed(1)} s` : v < 7200 ? `${Math.floor(v / 60)} min ${Math.floor(v % 60)} s` : `${(v / 3600).toFixed(2)} h`;
const FIGURES = [
  ['seconds', 'time', duration], ['gaussians', 'Gaussians', whole], ['steps', 'steps', whole],
  ['steps_per_second', 'steps a second', fixed(1)], ['frames_per_second', 'frames a second', fixed(1)],
  ['tracked_per_second', 'tracked a second', fixed(1)], ['dropped', 'frames dropped', whole], ['keyframes', 'keyframes', whole],
  ['held_out_psnr', 'PSNR, held out', v => `${v.toFixed(2)} dB`], ['psnr_tracked', 'PSNR, tracked', v => `${v.toFixed(2)} dB`],
  ['memory_mb', 'memory', v => `${whole(v)} MB`], ['origin', 'origin', v => v.join(', ')],
];
const SOURCES = { board: 'pose: board', track: 'pose: tracked', file: 'pose: file', known: 'pose: known', none: 'no pose' };
const GOOD = /fitting|track|done|saved|finish/i, WARN = /wait|pause|throttl|slow|settl/i, BAD = /lost|fail|error|stop/i;
const number = v => typeof v === 'number' && Number.isFinite(v);
const sound = p => {
  const keys = ['fx', 'fy', 'cx', 'cy', 'width', 'height'];
  const whole = p && Array.isArray(p.R_cw) && p.R_cw.length === 9 && Array.isArray(p.t_cw) && p.t_cw.length === 3;
  const valid = whole && [...p.R_cw, ...p.t_cw, ...keys.map(k => p[k])].every(number) && p.fx > 0 && p.fy > 0 && p.width > 0 && p.height > 0;
  const turned = valid && dot(cross(rowOf(p.R_cw, 0), rowOf(p.R_cw, 1)), rowOf(p.R_cw, 2)); // 1 of a rotation
  return valid && Math.abs(turned - 1) < 0.01 ? p : null;
};
const pose = () => sound(status.pose);
const views = () => Array.isArray(status.views) ? status.views.filter(sound) : [];

function showState(text, kind) {
  $('state').textContent = text;
  $('state').className = `state ${kind || (BAD.test(text) ? 'bad' : WARN.test(text) ? 'warn' : GOOD.test(text) ? 'good' : '')}`;
}

function showStatus() {
  showState(status.state || 'connected');
  $('throttled').hidden = !status.throttled;
  if (!told) show($('message'), status.message);
  show($('advice'), status.advice);
  $('coverage').hidden = !status.buttons;
  const rows = FIGURES.filter(([key]) => [status[key]].flat().every(number)).map(([key, name, format]) => {
    const row = document.createElement('tr');
    for (const text of [name, format(status[key])]) row.appendChild(document.createElement('td')).textContent = text;
    return row;
  });
  $('figures').replaceChildren(...rows);
  $('numbers').hidden = !rows.length;
  $('buttons').hidden = !status.buttons;
  $('pause').textContent = status.state === 'paused' ? 'Go on' : 'Pause';
  $('lock').textContent = status.exposure_locked ? 'Unlock exposure' : 'Lock exposure';
  $('lock').hidden = typeof status.exposure_locked !== 'boolean';
  $('to-pose').disabled = !pose();
  document.body.classList.toggle('still', status.still === true);
  showViews();
  if ($('follow').checked && pose()) orbit.fromPose(pose());
  else if (!placed && pose() && view.count) placed = firstView();
}

// Places to choose from, where the status has some.
function showViews() {
  const count = views().length;
  $('views-label').hidden = !count;
  if ($('views').options.length !== count) $('views').replaceChildren(...Array.from({ length: count }, (_, i) => new Option(i + 1, i)));
}

function show(element, text) {
  element.hidden = !text;
  element.textContent = text || '';
}

// ---- Pictures ----

const pictures = { camera: null, render: null };

function drawPicture(name) {
  const canvas = $(name), picture = pictures[name], c = canvas.getContext('2d');
  $(`${name}-panel`).hidden = false;
  canvas.style.aspectRatio = `${picture.width} / ${picture.height}`;
  // A small picture is drawn larger, so that the lines over it are fine.
  const screen = canvas.clientWidth * Math.min(devicePixelRatio, 2), scale = Math.max(1, Math.min(4, Math.ceil(screen / picture.width)));
  if (canvas.width !== picture.width * scale || canvas.height !== picture.height * scale)
    [canvas.width, canvas.height] = [picture.width * scale, picture.height * scale];
  c.setTransform(scale, 0, 0, scale, 0, 0);
  c.drawImage(picture, 0, 0);
  const facts = [`${picture.width}\u00d7${picture.height}`];
  if (name === 'camera') {
    const pixel = picture.width / (canvas.clientWidth || picture.width); // of the picture, a px of the screen
    if (Array.isArray(status.corners)) drawCorners(c, status.corners, pixel);
    const coverage = coverageWanted && pose() && soundCoverage(status.coverage);
    if (coverage) drawCoverage(c, coverage, pose(), picture, pixel);
    if (pose() && status.pose_from !== 'none') drawAxes(c, pose(), picture, pixel);
    if (SOURCES[status.pose_from]) facts.push(SOURCES[status.pose_from]);
    if (Array.isArray(status.corners) && status.corners.length) facts.push(`${status.corners.length} corners`);
  }
  $(`${name}-facts`).textContent = facts.join(', ');
}

// Four a tag, around it.
function drawCorners(c, corners, pixel) {
  c.lineWidth = 1.5 * pixel;
  c.strokeStyle = '#ffd24a';
  c.fillStyle = '#ffd24a';
  for (let i = 0; i + 3 < corners.length; i += 4) {
    c.beginPath();
    for (let k = 0; k < 4; k++) c.lineTo(...corners[i + k]);
    c.closePath();
    c.stroke();
    c.fillRect(corners[i][0] - 2.5 * pixel, corners[i][1] - 2.5 * pixel, 5 * pixel, 5 * pixel); // the first corner
  }
}

// The world's axes from its origin, a sixth of the picture long if they lay across it.
function drawAxes(c, p, picture, pixel) {
  const scale = picture.width / p.width, place = w => {
    const q = add(apply(p.R_cw, w), p.t_cw);
    return q[2] > 0 ? [(p.fx * q[0] / q[2] + p.cx) * scale, (p.fy * q[1] / q[2] + p.cy) * scale] : null;
  };
  const origin = place([0, 0, 0]), length = p.t_cw[2] * p.width / p.fx / 6;
  if (!origin) return;
  c.font = `600 ${12 * pixel}px sans-serif`;
  [['x', '#ff5148'], ['y', '#43d05f'], ['z', '#5a9bff']].forEach(([name, color], k) => {
    const end = place([0, 1, 2].map(i => i === k ? length : 0));
    if (!end) return;
    for (const [width, style] of [[5, '#000a'], [2.5, color]]) {
      c.lineWidth = width * pixel;
      c.strokeStyle = style;
      c.beginPath();
      c.moveTo(...origin);
      c.lineTo(...end);
      c.stroke();
    }
    c.fillStyle = color;
    c.fillText(name, end[0] + 4 * pixel, end[1] + 4 * pixel);
  });
}

// ---- The model ----

let placed = false, dirty = false, told = null;
const redraw = () => {
  if (dirty) return;
  dirty = true;
  requestAnimationFrame(draw);
};
const note = text => show($('view-note'), text);
const chart = new QualityChart($('chart'), $('quality-facts'));
const view = new SplatView($('view'), redraw);
const orbit = new Orbit($('view'), () => {
  redraw();
  if (orbit.byHand) keepView();
});

function draw() {
  dirty = false;
  if (!view.gl) return;
  fitCanvas($('view'));
  const background = Array.isArray(status.background) && status.background.length === 3 ? status.background : [0, 0, 0];
  if (view.count) view.draw({ ...orbit.camera($('view').width, $('view').height), background });
  $('view').dataset.settled = view.count && view.settled ? view.model : '';
}

// A link's view, else the camera's, else all of the model; false: wait for the camera's.
function firstView() {
  const link = /[#&]view=([^&]*)/.exec(location.hash);
  if (link && orbit.fromText(link[1])) return true;
  if (pose()) orbit.fromPose(pose());
  else orbit.all();
  return !!pose();
}

// The address holds the view, so that it can be handed on; not while a finger moves it.
let keeping = 0;
function keepView() {
  placed = true;
  $('follow').checked = false;
  clearTimeout(keeping);
  keeping = setTimeout(() => history.replaceState(null, '', `${location.pathname}#view=${orbit.toText()}`), 300);
}

// ---- Buttons ----

// In the place of the program's message, for a while.
function tell(text) {
  clearTimeout(told);
  show($('message'), text);
  told = setTimeout(() => { told = null; show($('message'), status.message); }, 4000);
}

async function command(name, done) {
  try {
    const answer = await ask('command', 8000, {
      method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify({ command: name }),
    });
    tell(answer.ok ? done : `Not done: ${await answer.text()}`);
  } catch (e) {
    tell('Not done: the program does not answer.');
  }
}

let sure = 0;
function reset() {
  const button = $('reset'), calm = () => {
    button.classList.remove('sure');
    button.textContent = 'Reset';
  };
  clearTimeout(sure);
  if (button.classList.contains('sure')) {
    calm();
    command('reset', 'The model is given up; the fit begins anew.');
    return;
  }
  button.classList.add('sure');
  button.textContent = 'Give the model up?';
  sure = setTimeout(calm, 4000);
}

$('pause').onclick = () => status.state === 'paused' ? command('go-on', 'Going on.') : command('pause', 'Pausing.');
$('save').onclick = () => command('save', 'Saving the model.');
$('lock').onclick = () => status.exposure_locked ? command('unlock-exposure', 'The exposure is the camera\'s again.')
  : command('lock-exposure', 'The exposure stays as it is.');
$('reset').onclick = reset;
$('coverage').onclick = () => {
  coverageWanted = !coverageWanted;
  $('coverage').setAttribute('aria-pressed', coverageWanted);
  if (pictures.camera) drawPicture('camera');
};
$('to-pose').onclick = () => { orbit.byHand = false; placed = true; orbit.fromPose(pose()); };
$('follow').onchange = () => { orbit.byHand = false; if ($('follow').checked && pose()) orbit.fromPose(pose()); };
$('views').onchange = () => { orbit.byHand = false; placed = true; orbit.fromPose(views()[$('views').value]); };
$('to-model').onclick = () => { orbit.all(); };

// ---- The start ----

// The cookie has the token from now on; the address bar need not show it.
if (location.search.includes('token=')) history.replaceState(null, '', location.pathname + location.hash);
if (!view.gl) note('this browser draws no WebGL2');
const seen = new IntersectionObserver(entries => {
  for (const e of entries) looks[e.target.id.replace('-panel', '')] = e.isIntersecting;
});
for (const id of ['camera-panel', 'render-panel', 'viewer']) seen.observe($(id));
new ResizeObserver(redraw).observe($('view'));
document.addEventListener('visibilitychange', redraw);
addEventListener('hashchange', () => { placed = firstView(); });
poll();
