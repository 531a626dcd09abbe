// The card of those who may change the unit: sends a bundle in blocks, from where the unit wants it,
// and asks for a restart or a factory reset.
(() => {
  const BLOCK_BYTES = 65536, SIGNATURE_AT = 24, SIGNATURE_BYTES = 64;
  const PAUSES_S = [0.5, 1, 2, 4, 8];
  const WORDS = { nothing: 'up to date', receiving: 'receiving', installing: 'installing', restart_needed: 'restart needed' };
  const $ = (id) => document.getElementById(id);
  const wait = (s) => new Promise((done) => setTimeout(done, 1000 * s));
  let busy = false, absent = false;

  async function ask(method, path, body) {
    const answer = await fetch(path, { method, body, cache: 'no-store' });
    const told = await answer.json();
    if (told.error) throw Object.assign(new Error(told.error), { status: answer.status });
    return told;
  }
  function say(error) { $('update-error').textContent = error || ''; }

  function show(now) {
    $('update').hidden = false;
    $('update-state').textContent = WORDS[now.state] || now.state;
    $('update-message').textContent = now.message || `Version ${now.version} runs from slot ${now.slot}.`;
    $('update-message').className = now.bad_news ? 'bad' : '';
    if ($('update-error').textContent === now.message) say('');  // once is enough
    const bar = $('update-progress'), sent = now.state === 'receiving', done = now.state === 'installing';
    bar.hidden = !sent && !done;
    if (sent && now.bundle_bytes) bar.value = now.received_bytes / now.bundle_bytes;
    if (done && now.chunks) bar.value = now.chunks_done / now.chunks;
  }
  async function look() {
    const session = await ask('GET', '/api/v1/session');
    if (session.scope !== 'admin') { $('update').hidden = true; return; }
    try { show(await ask('GET', '/api/v1/update')); }
    catch (error) { absent = error.status === 501; if (absent) $('update').hidden = true; }
  }

  // The unit knows a bundle by its signature, and how much of it it has.
  async function whereToBegin(file, sent) {
    const head = new Uint8Array(await file.slice(SIGNATURE_AT, SIGNATURE_AT + SIGNATURE_BYTES).arrayBuffer());
    const own = Array.from(head, (byte) => byte.toString(16).padStart(2, '0')).join('');
    const now = await ask('GET', '/api/v1/update');
    return now.state === 'receiving' && now.signature === own ? now.received_bytes : sent === file.size ? sent : 0;
  }
  async function send(file) {
    let tries = 0;
    for (let at = await whereToBegin(file, 0); at < file.size;) {
      const block = file.slice(at, at + BLOCK_BYTES);
      try {
        const now = await ask('POST', `/api/v1/update?at=${at}&of=${file.size}`, block);
        show(now);
        at = now.state === 'receiving' ? now.received_bytes : at + block.size;
        tries = 0;
      } catch (error) {
        // What the unit refuses stays refused; a lost connection is tried again.
        if ((error.status && error.status !== 503) || tries === PAUSES_S.length) throw error;
        await wait(PAUSES_S[tries++]);
        at = await whereToBegin(file, at + block.size);
      }
    }
  }
  async function alone(work) {
    if (busy) return;
    busy = true;
    say('');
    try { await work(); } catch (error) { say(error.message); }
    busy = false;
  }

  $('update-form').addEventListener('submit', (event) => {
    event.preventDefault();
    const file = $('update-file').files[0];
    if (file) alone(() => send(file));
  });
  $('update-restart').addEventListener('click', () => alone(async () => {
    if (confirm('Restart the unit? Nobody is counted for about a minute.')) await ask('POST', '/api/v1/restart');
  }));
  $('update-reset').addEventListener('click', () => alone(async () => {
    if (confirm('At its next start the unit forgets everything but its name and calibration, its settings and tokens included. Go on?'))
      show(await ask('POST', '/api/v1/factory-reset'));
  }));
  setInterval(() => { if (!busy && !absent && !document.hidden) look().catch(() => {}); }, 2000);
  look().catch(() => {});
})();
