// Mouse, touch and keys.
const canvas = el('canvas');
const at = (event) => { const box = canvas.getBoundingClientRect(); return { x: event.clientX - box.left, y: event.clientY - box.top }; };
const hit = (p) => (app.mode === 'corners' ? nearest(app.view.corners, p, HIT / stage.scale) : null);
const fingers = new Map();

canvas.addEventListener('pointerdown', (event) => {
  if (!app.view) return;
  canvas.setPointerCapture(event.pointerId);
  const screen = at(event), p = stage.toPixel(screen.x, screen.y);
  fingers.set(event.pointerId, screen);
  const grabbed = event.button === 0 && fingers.size === 1 ? hit(p) : null;
  app.drag = { screen, last: screen, moved: false, pan: event.button !== 0 || fingers.size > 1, corner: grabbed && { ...grabbed }, from: grabbed && { ...grabbed } };
  if (grabbed) { app.chosen = grabbed.id; render(); }
});
canvas.addEventListener('pointermove', (event) => {
  if (!app.view) return;
  const screen = at(event), drag = app.drag;
  if (drag && fingers.size === 2) {
    const [a, b] = [...fingers.values()], before = Math.hypot(a.x - b.x, a.y - b.y);
    fingers.set(event.pointerId, screen);
    const [c, d] = [...fingers.values()];
    stage.zoom(Math.hypot(c.x - d.x, c.y - d.y) / Math.max(1, before), (c.x + d.x) / 2, (c.y + d.y) / 2);
    drag.moved = true;
    return;
  }
  stage.cursor = stage.toPixel(screen.x, screen.y);
  app.hovering = true; app.crosshair = false;
  if (drag) {
    if (Math.hypot(screen.x - drag.screen.x, screen.y - drag.screen.y) > 4) drag.moved = true;
    if (drag.moved && drag.corner) {
      drag.corner.x = drag.from.x + (screen.x - drag.screen.x) / stage.scale;
      drag.corner.y = drag.from.y + (screen.y - drag.screen.y) / stage.scale;
      const own = corner(drag.corner.id);
      if (own) Object.assign(own, { x: drag.corner.x, y: drag.corner.y });
    } else if (drag.moved) {
      stage.pan(screen.x - drag.last.x, screen.y - drag.last.y);
      canvas.classList.add('panning');
    }
    drag.last = screen;
  } else {
    canvas.classList.toggle('over', Boolean(hit(stage.cursor)));
  }
  renderStage();
});
async function release(event) {
  fingers.delete(event.pointerId);
  canvas.classList.remove('panning');
  const drag = app.drag;
  app.drag = null;
  if (!drag || !app.view) return;
  if (drag.moved && drag.corner) {
    const p = drag.corner;
    if (!inside(p)) { Object.assign(corner(p.id), drag.from); return render(); }
    return act(async () => put(p.id, await snapped(p, event.altKey)));
  }
  if (drag.moved || drag.pan || drag.corner) return;
  app.chosen = null;
  placeSoon(stage.toPixel(drag.screen.x, drag.screen.y), event.altKey);
}
canvas.addEventListener('pointerup', release);
canvas.addEventListener('pointercancel', (event) => { fingers.delete(event.pointerId); if (app.drag?.corner) Object.assign(corner(app.drag.corner.id), app.drag.from); app.drag = null; render(); });
canvas.addEventListener('pointerleave', () => { app.hovering = false; if (!app.drag) renderStage(); });
canvas.addEventListener('contextmenu', (event) => event.preventDefault());
canvas.addEventListener('wheel', (event) => {
  event.preventDefault();
  const screen = at(event);
  stage.zoom(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0016)), screen.x, screen.y);
}, { passive: false });

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
function arrow([dx, dy], fast) {
  if (app.mode === 'corners' && app.chosen !== null) { app.hovering = false; return nudge(dx * (fast ? 1 : 0.1), dy * (fast ? 1 : 0.1)); }
  const pace = (fast ? 20 : 3) / stage.scale;
  stage.cursor ||= { x: app.view.width / 2, y: app.view.height / 2 };
  stage.cursor = { x: Math.min(app.view.width - 1, Math.max(0, stage.cursor.x + dx * pace)), y: Math.min(app.view.height - 1, Math.max(0, stage.cursor.y + dy * pace)) };
  app.crosshair = true;
  stage.reveal(stage.cursor);
  renderStage();
}
function nextChosen(back) {
  const ids = app.view.corners.map((c) => c.id), i = ids.indexOf(app.chosen) + (back ? -1 : 1);
  if (i < 0 || i >= ids.length) { app.chosen = null; render(); return false; }
  app.hovering = false;
  choose(ids[i]);
  return true;
}
let digitTimer = 0;
function digit(key) {
  app.digits += key;
  clearTimeout(digitTimer);
  digitTimer = setTimeout(() => { app.digits = ''; }, 1200);
  const id = Number(app.digits);
  if (id < total()) choose(id); else { app.digits = ''; toast(`The board has the IDs 0 to ${total() - 1}.`); }
}
const KEYS = {
  a: () => { if (app.view.prediction?.mirrored) toast('First the IDs must run the right way round.'); else if (predicted().length || app.view.prediction && !app.view.placed) act(accept); else toast('Nothing is predicted: set four corners that are not on one line.'); },
  z: () => act(() => step('api/undo')), y: () => act(() => step('api/redo')),
  n: () => go(1), p: () => go(-1), u: () => go(1, true), f: () => stage.fit(), '+': () => stage.zoom(1.3), '=': () => stage.zoom(1.3), '-': () => stage.zoom(1 / 1.3),
  m: () => setMode(app.mode === 'corners' ? 'targets' : 'corners'),
  delete: () => { remove(); }, backspace: () => KEYS.delete(),
  escape: () => { app.chosen = null; app.pinned = null; app.crosshair = false; render(); },
  '?': () => el('help').showModal(),
};
addEventListener('keydown', (event) => {
  if (!app.view || el('help').open || event.target.tagName === 'INPUT' && event.target.type !== 'checkbox') return;
  const key = event.key.toLowerCase(), command = event.ctrlKey || event.metaKey;
  if (command && key === 'z') { event.preventDefault(); return KEYS[event.shiftKey ? 'y' : 'z'](); }
  if (command && key === 'y') { event.preventDefault(); return KEYS.y(); }
  if (command || event.altKey && key !== 'enter') return;
  const onImage = document.activeElement === canvas;
  if (ARROWS[event.key] && (onImage || document.activeElement === document.body)) { event.preventDefault(); return arrow(ARROWS[event.key], event.shiftKey); }
  if (key === 'enter' && onImage && stage.cursor) { event.preventDefault(); app.chosen = null; return placeSoon(stage.cursor, event.altKey); }
  if (key === 'tab' && onImage && app.mode === 'corners' && app.view.corners.length) { if (nextChosen(event.shiftKey)) event.preventDefault(); return; }
  if (key === 'z' && event.shiftKey) return KEYS.y();
  if (/^[0-9]$/.test(key) && app.mode === 'corners') return digit(key);
  if (KEYS[key]) { event.preventDefault(); KEYS[key](); }
});
const on = (id, work) => el(id).addEventListener('click', () => { work(); el('canvas').focus({ preventScroll: true }); });
on('undo', KEYS.z); on('redo', KEYS.y); on('accept', KEYS.a); on('remove', KEYS.delete); on('turn', () => act(turn));
on('clear', () => act(() => edit([]))); on('fit', KEYS.f); on('zoom-in', KEYS['+']); on('zoom-out', KEYS['-']);
on('mode-corners', () => setMode('corners')); on('mode-targets', () => setMode('targets'));
el('help-open').addEventListener('click', KEYS['?']);
el('todo').addEventListener('change', renderList);
el('add-target').addEventListener('submit', (event) => {
  event.preventDefault();
  const id = el('target-name').value.trim();
  if (!id || target(id)) return toast(id ? `Target ${id} is there already.` : 'A target needs a name.');
  app.target = id; el('target-name').value = '';
  el('target-name').blur();
  quietly(setTargets([...app.state.targets, { id, seen: [] }]));
});
(async () => {
  try {
    app.state = await ask('api/state');
    const wanted = Number(location.hash.slice(1));
    const first = app.state.images.findIndex((image) => image.corners === 0);
    const index = location.hash && wanted < app.state.images.length ? wanted : Math.max(0, first);
    await load(index);
  } catch { /* told already */ }
})();
