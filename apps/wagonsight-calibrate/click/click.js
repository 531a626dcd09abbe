// What a person does: choose an image, place, move and delete corners, accept, undo; targets.
const app = { state: null, view: null, image: -1, mode: 'corners', chosen: null, pinned: null, refused: new Set(), target: null, digits: '', drag: null };
const stage = new Stage(el('canvas'), el('magnifier'));
const HIT = 10;        // screen pixels within which a corner is meant
const MISFIT_PX = 2.5;  // pixels a clicked corner may be off the fitted board before it is marked

// ---- the tool: one request at a time, in the order they were made
let queue = Promise.resolve();
function ask(path, body) {
  const run = async () => {
    saved('busy', 'saving');
    const answer = await fetch(path, body === undefined ? {} : { method: 'POST', body: JSON.stringify(body) });
    const told = await answer.json();
    if (!answer.ok) throw Object.assign(new Error(told.error), { status: answer.status });
    saved('', 'saved');
    return told;
  };
  const mine = queue.then(run);
  queue = mine.catch(() => {});
  return mine.catch((error) => {
    if (error.status) { saved('bad', 'refused'); setTimeout(() => saved('', 'saved'), 4000); toast(error.message); if (error.status === 409) refresh(); } else lost();
    throw error;
  });
}
const quietly = (promise) => promise.catch(() => {});
// What a person does quickly after another starts from what the one before has made.
let acting = Promise.resolve();
function act(work) {
  const mine = acting.then(work);
  acting = quietly(mine);
  return acting;
}
function saved(kind, text) { el('saved').className = 'saved ' + kind; el('saved').lastElementChild.textContent = text; }
let waitingForTool = false;
async function lost() {
  if (waitingForTool) return;
  waitingForTool = true;
  el('lost').hidden = false; saved('bad', 'no link');
  for (;;) {
    await new Promise((done) => setTimeout(done, 1000));
    try { if ((await fetch('api/state')).ok) break; } catch { /* still gone */ }
  }
  waitingForTool = false;
  await quietly(refresh());
  el('lost').hidden = true;
}
async function refresh() {
  app.state = await ask('api/state');
  if (app.image >= 0) await load(app.image, true); else render();
}
let toastTimer = 0;
function toast(text) {
  const node = el('toast');
  node.textContent = text; node.hidden = false;
  clearTimeout(toastTimer);
  toastTimer = setTimeout(() => { node.hidden = true; }, 5000);
}

// ---- images
const total = () => app.state.board.rows * app.state.board.columns;
const isWhole = (image) => image.corners >= total();
async function load(index, keep) {
  const view = await ask(`api/view?image=${index}`);
  if (!keep || app.image !== index) {
    const picture = new Image();
    picture.src = `api/image?image=${index}`;
    try { await picture.decode(); } catch { toast('This image cannot be shown.'); return; }
    app.image = index; app.chosen = null; app.pinned = null; app.refused = new Set();
    location.replace(`#${index}`);
    stage.show(picture);
  }
  take(view);
}
function take(view) {
  app.view = view;
  app.state.undo = view.undo; app.state.redo = view.redo;
  app.state.images[view.image].corners = view.corners.length;
  if (app.chosen !== null && !corner(app.chosen)) app.chosen = null;
  if (app.pinned !== null && corner(app.pinned)) app.pinned = null;
  render();
}
function go(step, unfinished) {
  const images = app.state.images;
  for (let i = 1; i <= images.length; ++i) {
    const index = (app.image + step * i + images.length * i) % images.length;
    if (!unfinished || images[index].corners === 0) return act(() => load(index));
  }
  toast('Every image has corners.');
}

// ---- corners
const corner = (id) => app.view.corners.find((c) => c.id === id);
const predicted = () => app.view?.prediction?.corners || [];
// The four outer corners first, then whatever is missing.
function nextId() {
  if (app.pinned !== null) return app.pinned;
  const { rows, columns } = app.state.board, n = rows * columns;
  const outer = [0, columns - 1, n - 1, n - columns].find((id) => !corner(id));
  if (app.view.corners.length < 4 && outer !== undefined) return outer;
  for (let id = 0; id < n; ++id) if (!corner(id)) return id;
  return null;
}
const edit = (corners) => ask('api/edit', { image: app.image, revision: app.view.revision, corners }).then(take);
const put = (id, p) => edit([...app.view.corners.filter((c) => c.id !== id), { id, x: p.x, y: p.y }]);
async function snapped(p, raw) {
  if (raw) return p;
  const radius = Math.min(40, Math.max(2.5, 12 / stage.scale));
  const found = await ask('api/snap', { image: app.image, x: p.x, y: p.y, radius });
  if (!found.found) toast('No saddle here: the corner stays where you clicked.');
  return found.found ? found : p;
}
function nearest(list, p, reach) {
  let best = null, least = reach;
  for (const item of list) {
    const d = Math.hypot(item.x - p.x, item.y - p.y);
    if (d < least) { least = d; best = item; }
  }
  return best;
}
// Where the person clicked; `pinned` is the ID that was chosen by then, or null.
async function place(p, raw, pinned) {
  if (!inside(p)) return;
  if (app.mode === 'targets') return placeBall(p, raw);
  const meant = pinned === null ? predicted().reduce((best, c) => {
    const d = Math.hypot(c.x - p.x, c.y - p.y);
    return d < 0.45 * c.spacing && d < (best?.d ?? 1e9) ? { id: c.id, d } : best;
  }, null) : null;
  const id = pinned ?? meant?.id ?? nextId();
  if (id === null) return toast('Every corner of the board is set.');
  await put(id, await snapped(p, raw));
}
function placeSoon(p, raw) {
  const { pinned, image } = app;
  app.pinned = null; app.digits = '';
  return act(() => (image === app.image ? place(p, raw, pinned) : undefined));
}
const inside = (p) => p.x >= 0 && p.y >= 0 && p.x <= app.view.width - 1 && p.y <= app.view.height - 1;
async function accept() {
  const told = await ask('api/accept', { image: app.image, revision: app.view.revision });
  app.refused = new Set(told.refused);
  take(told);
  const added = told.added === 1 ? 'One corner added' : `${told.added} corners added`, left = told.refused.length;
  if (left > total() / 2) toast(`${added}. Most predicted corners show no saddle: is one of the IDs wrong, or not at its corner?`);
  else toast(`${added}${left ? `; ${left} show no saddle and were left out: hidden, or click them yourself` : ''}.`);
}
function remove() {
  if (app.mode === 'targets') return act(removeSighting);
  if (app.chosen === null) return toast('Choose a corner first: click on it.');
  const id = app.chosen;
  return act(() => edit(app.view.corners.filter((c) => c.id !== id)));
}
const turn = () => edit(app.view.corners.map((c) => ({ ...c, id: total() - 1 - c.id })));
async function step(path) {
  const told = await ask(path, {});
  app.state.targets = told.targets; app.state.undo = told.undo; app.state.redo = told.redo;
  if (told.image !== undefined) { setMode('corners'); await load(told.image, told.image === app.image); } else { setMode('targets'); render(); }
}
let nudging = null;
// Arrow keys gather for a moment, so that ten of them are one step back.
function nudge(dx, dy) {
  const c = corner(app.chosen);
  c.x = Math.min(app.view.width - 1, Math.max(0, c.x + dx)); c.y = Math.min(app.view.height - 1, Math.max(0, c.y + dy));
  render();
  clearTimeout(nudging);
  nudging = setTimeout(() => act(() => edit(app.view.corners)), 300);
}

// ---- targets
const target = (id) => app.state.targets.find((t) => t.id === id);
const setTargets = async (targets) => { app.state = await ask('api/targets', { targets }); render(); };
const here = () => app.state.images[app.image];
const isHere = (s) => s.sensor === here().sensor && (s.image === undefined || s.image === here().name);
async function placeBall(p, raw) {
  if (app.target === null) return toast('Add or choose a target first.');
  let found = { found: true, x: p.x, y: p.y };
  if (!raw) {
    found = await ask('api/ball', { image: app.image, x: p.x, y: p.y });
    if (!found.found) return toast('No outline of a ball here. Click on its middle, or with Alt to take the very pixel.');
  }
  const sighting = { sensor: here().sensor, image: here().name, x: found.x, y: found.y, ...(found.outline && { outline: found.outline }) };
  await setTargets(app.state.targets.map((t) => (t.id !== app.target ? t
    : { ...t, seen: [...(t.seen || []).filter((s) => s.sensor !== sighting.sensor), sighting] })));
  if (found.outline) toast(`Outline found: ${Math.round(found.seen * 100)}% of it, ${found.rms.toFixed(2)} px from an ellipse${found.corrected > 0.005 ? `, its middle moved by ${found.corrected.toFixed(2)} px to the ball's` : ''}.`);
}
function removeSighting() {
  if (app.target === null) return toast('Choose a target first.');
  return setTargets(app.state.targets.map((t) => (t.id !== app.target ? t : { ...t, seen: (t.seen || []).filter((s) => !isHere(s)) })));
}
function setMode(mode) {
  app.mode = mode; document.body.dataset.mode = mode;
  el('mode-corners').setAttribute('aria-pressed', mode === 'corners');
  el('mode-targets').setAttribute('aria-pressed', mode === 'targets');
  render();
}

// ---- what is shown
function node(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}
function render() {
  if (!app.view) return;
  renderList(); renderBoard(); renderFit(); renderTargets(); renderStage();
  const image = here(), count = app.view.corners.length;
  el('name').textContent = image.name;
  document.title = `${image.name} · wagonsight`;
  el('state').textContent = count === 0 ? 'no corners' : isWhole(image) ? `all ${count} corners` : `${count} of ${total()} corners`;
  el('state').className = 'chip ' + (isWhole(image) ? 'whole' : count ? 'some' : '');
  el('undo').disabled = !app.state.undo; el('redo').disabled = !app.state.redo;
  el('remove').disabled = app.chosen === null; el('clear').disabled = el('turn').disabled = count === 0;
  el('accept').disabled = predicted().length === 0 && app.view.placed;
  renderAdvice(count);
  document.body.dataset.ready = 'yes';
}
function renderList() {
  const list = el('list'), only = el('todo').checked, groups = new Map();
  app.state.images.forEach((image, index) => { if (!groups.has(image.sensor)) groups.set(image.sensor, []); groups.get(image.sensor).push({ image, index }); });
  list.replaceChildren();
  for (const [sensor, members] of groups) {
    const done = members.filter((m) => m.image.corners > 0).length;
    list.append(node('h3', {}, node('span', { textContent: sensor }), node('span', { textContent: `${done} of ${members.length}` })));
    for (const { image, index } of members) {
      if (only && image.corners > 0 && index !== app.image) continue;
      const button = node('button', { title: image.name, onclick: () => act(() => load(index)) },
        node('span', { textContent: image.name.slice(sensor.length + 1) }),
        node('span', { className: 'count ' + (isWhole(image) ? 'whole' : image.corners ? 'some' : ''), textContent: image.corners || '–' }));
      button.setAttribute('aria-label', `${image.name}, ${image.corners} corners`);
      if (index === app.image) button.setAttribute('aria-current', 'true');
      list.append(button);
    }
  }
  const done = app.state.images.filter((image) => image.corners > 0).length;
  el('progress').textContent = `${done} of ${app.state.images.length} have corners`;
}
const misfits = () => new Map((app.view.prediction?.misfits || []).filter((m) => m.length > MISFIT_PX && app.view.corners.length > 4).map((m) => [m.id, m.length]));
function renderBoard() {
  const board = el('board'), { columns } = app.state.board, next = nextId(), off = misfits();
  el('next').textContent = next === null ? 'all set' : `next: ID ${next}`;
  if (total() > 600) { board.textContent = 'The board is large: type an ID to choose it.'; return; }
  const expected = new Set(predicted().map((c) => c.id));
  if (board.childElementCount !== total()) {
    board.style.gridTemplateColumns = `repeat(${columns}, minmax(0, 1fr))`;
    board.replaceChildren(...Array.from({ length: total() }, (_, id) => node('button', { textContent: id, onclick: () => choose(id) })));
  }
  for (const button of board.children) {
    const id = Number(button.textContent), set = Boolean(corner(id));
    button.className = [set ? 'set' : expected.has(id) ? 'predicted' : '', off.has(id) ? 'misfit' : '', (app.chosen ?? next) === id ? 'chosen' : ''].join(' ').trim();
    button.setAttribute('aria-label', `corner ${id}, ${set ? 'set' : expected.has(id) ? 'predicted' : 'not set'}`);
  }
}
function choose(id) {
  if (corner(id)) { app.chosen = id; app.pinned = null; stage.reveal(corner(id)); } else { app.chosen = null; app.pinned = id; }
  render();
  el('canvas').focus({ preventScroll: true });
}
function renderFit() {
  const p = app.view.prediction;
  el('fitness').textContent = !p ? 'Four corners that are not on one line predict the rest.'
    : app.view.corners.length === 4 ? 'Four corners fit any board; a fifth will tell.'
      : `The corners lie ${p.rms.toFixed(2)} px (RMS) from one flat board.`;
  el('misfits').replaceChildren(...[...misfits()].slice(0, 6).map(([id, length]) =>
    node('li', { onclick: () => choose(id) }, node('span', { textContent: `ID ${id}: wrong ID or badly placed?` }), node('span', { textContent: `${length.toFixed(1)} px` }))));
}
function renderAdvice(count) {
  const advice = el('advice'), p = app.view.prediction, next = nextId();
  const bad = Boolean(p?.mirrored) && app.mode === 'corners';
  advice.className = 'advice' + (bad ? ' bad' : '');
  const place = { 0: 'the first corner of the first row', [app.state.board.columns - 1]: 'the last corner of the first row',
    [total() - 1]: 'the last corner of the last row', [total() - app.state.board.columns]: 'the first corner of the last row' }[next];
  advice.textContent = app.mode === 'targets'
    ? (app.target === null ? 'Add a target by its name, give its measured place, then click on its ball.' : `Click on the ball of target ${app.target}; with Alt the very pixel is taken.`)
    : !app.view.placed && count > 0 ? 'Detection could not tell where on the board these corners are, so their IDs are a guess. Clear them and click anew, or press A if they are right.'
    : bad ? 'The IDs run the wrong way round: with them the board would be seen from behind. Swap two of the corners.'
      : next === null ? 'Every corner is set. N shows the next image, U the next one to be done.'
        : p && predicted().length && app.refused.size > total() / 2 ? 'Hardly any predicted corner shows a saddle: look at the IDs and places of those that are set.'
        : p && predicted().length && predicted().every((c) => app.refused.has(c.id)) ? 'The dashed corners show no saddle: they are hidden and may stay away. U shows the next image to be done.'
        : p && predicted().length ? 'Press A to accept the predicted corners (dashed), or click on them one by one.'
          : p ? 'Every corner that lies in the image is set. U shows the next image to be done.'
            : `Click on corner ${next}${place ? ', ' + place : ''}. If it is hidden, choose another ID on the board or type it.`;
  if (count > 0 && count < 4 && app.mode === 'corners') advice.textContent += ` ${4 - count} more predict the rest.`;
}
function renderTargets() {
  if (el('targets').contains(document.activeElement) && document.activeElement.tagName === 'INPUT') return;
  el('targets').replaceChildren(...app.state.targets.map((t) => {
    const seen = (t.seen || []).map((s) => s.sensor), xyz = node('div', { className: 'xyz' });
    ['X', 'Y', 'Z'].forEach((axis, k) => {
      const input = node('input', { placeholder: `${axis} m`, inputMode: 'decimal', value: t.world?.[k] ?? '' });
      input.setAttribute('aria-label', `${axis} of target ${t.id} in metres`);
      xyz.append(input);
    });
    xyz.addEventListener('change', () => {
      const world = [...xyz.children].map((input) => (input.value.trim() === '' ? NaN : Number(input.value.replace(',', '.'))));
      if (world.every(Number.isFinite)) quietly(setTargets(app.state.targets.map((other) => (other.id === t.id ? { ...other, world } : other))));
    });
    return node('li', { className: t.id === app.target ? 'chosen' : '' },
      node('div', { className: 'target-head' },
        node('button', { className: 'pick', textContent: t.id, onclick: () => { app.target = t.id; render(); } }),
        node('button', { textContent: '✕', title: `Delete target ${t.id}`, ariaLabel: `Delete target ${t.id}`, onclick: () => { if (app.target === t.id) app.target = null; quietly(setTargets(app.state.targets.filter((o) => o.id !== t.id))); } })),
      xyz,
      node('p', { className: 'note', textContent: seen.length ? `seen by ${seen.join(', ')}${t.world ? '' : '; its measured place is missing'}` : 'not clicked yet' }));
  }));
}
function renderStage() {
  const off = misfits(), next = nextId(), corners = app.mode === 'corners';
  const balls = app.state.targets.flatMap((t) => (t.seen || []).filter(isHere).map((s) => ({ ...s, id: t.id, chosen: t.id === app.target })));
  stage.scene = {
    columns: app.state.board.columns,
    corners: corners ? app.view.corners.map((c) => ({ ...c, chosen: c.id === app.chosen, misfit: off.has(c.id) })) : [],
    predicted: corners && !app.view.prediction?.mirrored ? predicted().map((c) => ({ ...c, chosen: c.id === next })) : [],
    balls: corners ? [] : balls, crosshair: app.crosshair,
    focus: app.drag?.corner || (app.crosshair ? null : corners && !app.hovering && app.chosen !== null ? corner(app.chosen) : null),
  };
  stage.draw();
  const at = stage.scene.focus || stage.cursor;
  el('where').textContent = at ? `x ${at.x.toFixed(2)}  y ${at.y.toFixed(2)}` : '\u00a0';
}
