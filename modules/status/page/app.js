// The page's data: one stream of server-sent events, with patience when it breaks.
(() => {
  const STALE_S = 2.5;        // without news for so long, nothing on the page counts as now
  const FRESH_AGE_S = 3;      // the daemon's own silence, as the web side tells it
  const RETRY_S = [0.5, 1, 2, 4, 8];
  const HISTORY_S = 300;
  const SERIOUS = new Set(['fall', 'motionless', 'left_object', 'counter_flow', 'crowding']);
  const SAID = { fall: 'Fall', motionless: 'Not moving', crowding: 'Crowding', running: 'Running',
    counter_flow: 'Against the flow', left_object: 'Object left behind', boarding: 'Boarding', alighting: 'Alighting' };
  const VERDICTS = { ok: 'All is well', degraded: 'Works, with limits', failed: 'Not working', unknown: 'Connecting' };
  const calm = matchMedia('(prefers-reduced-motion: reduce)');

  const $ = (id) => document.getElementById(id);
  const seconds = () => performance.now() / 1000;
  const put = (id, text) => { const node = $(id); if (node.textContent !== text) node.textContent = text; };
  const percent = (share, digits = 0) => `${(100 * share).toFixed(digits)}%`;
  function make(tag, className, text) {
    const node = document.createElement(tag);
    if (className) node.className = className;
    if (text !== undefined) node.textContent = text;
    return node;
  }
  // A figure with its unit in small.
  function figure(id, value, unit) {
    const node = $(id), key = value + '|' + unit;
    if (node.dataset.key === key) return;
    node.dataset.key = key;
    node.textContent = value;
    if (unit) node.append(make('small', '', '\u00a0' + unit));
  }
  function duration(s) {
    if (s < 60) return `${Math.max(0, Math.floor(s))} s`;
    if (s < 3600) return `${Math.floor(s / 60)} min`;
    if (s < 2 * 86400) return `${Math.floor(s / 3600)} h`;
    return `${Math.floor(s / 86400)} days`;
  }
  const count = (n, one, many) => `${n} ${n === 1 ? one : many}`;

  let chosen = 0, state = null, frame = null, heard = -1e9, attempt = 0, source = null;
  let clockOffset = null;     // unix time minus the stream's time
  let limited = false;        // no token: counts only
  const history = [], eventLog = new Map();
  const view = new PlanView($('plan'), choose);

  function choose(id) {
    chosen = chosen === id ? 0 : id;
    view.choose(chosen);
    if (frame) showPeople(frame);
  }

  // ---- what the unit says of itself
  function showHealth(health) {
    document.body.dataset.verdict = health.verdict;
    put('verdict', VERDICTS[health.verdict] || health.verdict);
    put('sentence', health.verdict === 'degraded' ? stillDone()
      : health.verdict === 'failed' ? 'Do not rely on the counts until this is put right.' : health.sentence);
    $('simulated').hidden = !health.simulated;
    const key = JSON.stringify(health.faults.map((f) => [f.id, f.subject, f.weight, f.cause]));
    if ($('faults').dataset.key === key) return;
    $('faults').dataset.key = key;
    $('faults').replaceChildren(...health.faults.map((fault) => {
      const item = make('li', fault.weight);
      item.append(make('b', '', fault.cause), make('span', '', fault.next_action));
      return item;
    }));
  }

  // One that loses frames still watches.
  const watches = (sensor) => ['ok', 'learning', 'degraded'].includes(sensor.state);

  // Under limits: what still works. What does not is listed below it.
  function stillDone() {
    if (!state.sensors || !state.occupancy) return '';
    const well = state.sensors.filter(watches).length;
    return `${well} of ${state.sensors.length} sensors watch the wagon; ${count(state.occupancy.count, 'person is', 'people are')} inside.`;
  }

  function showOccupancy(o) {
    put('count', String(o.count));
    put('count-word', o.count === 1 ? 'person inside' : 'people inside');
    figure('fact-people', String(o.count), o.count === 1 ? 'person' : 'people');
    put('observed', o.quality === 'unknown' ? 'counts not reliable yet' : `${percent(o.observed_share)} of the room seen`);
    const list = $('zones');
    if (list.children.length !== o.zones.length) {
      list.replaceChildren(...o.zones.map((zone) => {
        const item = make('li'), track = make('div', 'track');
        track.append(make('i'));
        item.append(make('span', '', zone.name), make('b'), track);
        return item;
      }));
    }
    o.zones.forEach((zone, i) => {
      const item = list.children[i], full = zone.capacity ? zone.count / zone.capacity : 0;
      item.className = full >= 1 ? 'full' : full >= 0.8 ? 'busy' : '';
      item.children[0].textContent = zone.name;
      const number = item.children[1], text = `${zone.count}|${zone.capacity}`;
      if (number.dataset.key !== text) {
        number.dataset.key = text;
        number.textContent = String(zone.count);
        if (zone.capacity) number.append(make('small', '', ` of ${zone.capacity}`));
      }
      item.lastChild.firstChild.style.width = percent(Math.min(1, full));
    });
    const by = (s) => o.seats.filter((seat) => seat.state === s).length;
    put('seats', o.seats.length ? `${by('occupied')} of ${o.seats.length}` + (by('unobserved') ? `, ${by('unobserved')} not seen` : '') : 'none drawn');
    const rows = $('counts');
    while (rows.children.length < o.doors.length + 1) {
      const row = make('div');
      row.append(make('dt'), make('dd'));
      rows.append(row);
    }
    o.doors.forEach((door, i) => {
      rows.children[i + 1].firstChild.textContent = door.name;
      rows.children[i + 1].lastChild.textContent = `${door.boarded} in, ${door.alighted} out`;
    });
    const now = seconds();
    history.push([now, o.count]);
    while (history.length && history[0][0] < now - HISTORY_S) history.shift();
    drawHistory(now);
  }

  function drawHistory(now) {
    const most = Math.max(4, ...history.map((h) => h[1])) * 1.1;
    const x = (t) => (120 * (1 - (now - t) / HISTORY_S)).toFixed(2), y = (n) => (31 - 30 * n / most).toFixed(2);
    let d = '';
    history.forEach(([t, n], i) => { d += i ? `H${x(t)}V${y(n)}` : `M${x(t)} ${y(n)}`; });
    if (!d) return;
    d += 'H120';
    document.querySelector('#history .line').setAttribute('d', d);
    document.querySelector('#history .area').setAttribute('d', `${d}V32H${x(history[0][0])}Z`);
  }

  function showSensors(sensors) {
    const well = sensors.filter(watches).length;
    figure('fact-sensors', String(well), `of ${sensors.length}`);
    const body = $('sensors');
    if (!sensors.length) return body.replaceChildren();
    while (body.children.length < sensors.length) {
      const row = make('tr');
      for (let i = 0; i < 7; ++i) row.append(make('td', i > 1 ? 'n' : ''));
      row.children[1].append(make('span', 'pill'));
      body.append(row);
    }
    sensors.forEach((s, i) => {
      const cells = body.children[i].children;
      if (cells[0].dataset.key !== s.name + s.kind) {
        cells[0].dataset.key = s.name + s.kind;
        cells[0].textContent = s.name + ' ';
        cells[0].append(make('small', '', s.kind));
      }
      cells[1].firstChild.className = 'pill ' + s.state;
      cells[1].firstChild.textContent = s.state;
      cells[2].textContent = s.fps.toFixed(1);
      cells[3].textContent = `${s.skew_ms >= 0 ? '+' : '\u2212'}${Math.abs(s.skew_ms).toFixed(1)} ms`;
      cells[4].textContent = `${s.dropped + s.damaged}` + (s.dropped_share > 0 ? ` (${percent(s.dropped_share, 1)})` : '');
      cells[5].textContent = `${s.latency_ms.toFixed(0)} ms`;
      cells[6].textContent = percent(s.background_share);
    });
  }

  function showPipeline(p) {
    figure('fact-rate', p.rate_hz.toFixed(1), '/s');
    figure('fact-delay', p.latency_ms.toFixed(0), 'ms');
    const budget = 1000 / 30;
    const list = $('stages'), bar = $('budget');
    while (list.children.length < p.stages.length) {
      const item = make('li', 'c' + list.children.length % 8);
      item.append(make('i'), make('span'), make('b'));
      list.append(item);
      bar.append(make('i', 'c' + bar.children.length % 8));
    }
    let sum = 0;
    p.stages.forEach((stage, i) => {
      sum += stage.p50_ms;
      const cells = list.children[i].children;
      cells[1].textContent = stage.name;
      cells[2].textContent = `${stage.p50_ms.toFixed(1)} `;
      cells[2].append(make('small', '', `\u2264 ${stage.p99_ms.toFixed(1)} ms`));
      bar.children[i].style.width = percent(Math.min(1, stage.p50_ms / budget), 2);
    });
    put('timing-note', p.stages.length ? `${sum.toFixed(1)} of ${budget.toFixed(0)} ms for an instant` : 'no timings yet');
    figure('cpu', percent(p.cpu_share), 'of one core');
    figure('memory', (p.resident_bytes / 1048576).toFixed(1), 'MB');
    const heat = p.thermal;
    figure('heat', heat ? heat.celsius.toFixed(0) : 'not told', heat ? '\u00b0C' + (heat.rate_limit_hz ? `, at most ${heat.rate_limit_hz}/s` : '') : '');
    figure('skipped', String(p.framesets_dropped), `of ${p.framesets + p.framesets_dropped}`);
  }

  function showCalibration(c) {
    put('calibration-state', c.drift.alarm ? 'a sensor moved' : c.present ? 'in use' : 'none');
    put('cal-source', c.source || 'none');
    put('cal-age', c.age_s !== null ? `${duration(c.age_s)} ago` : 'not stated');
    const known = c.sensors.map((s) => s.rms_px).filter((v) => v !== null);
    put('cal-rms', known.length ? `${Math.min(...known).toFixed(2)} to ${Math.max(...known).toFixed(2)} px` : 'not stated');
    put('cal-geo', c.georeference.present ? c.georeference.sigma_m > 0 ? `known to ${(1000 * c.georeference.sigma_m).toFixed(0)} mm` : 'surveyed' : 'not surveyed');
    put('cal-drift', c.drift.text || 'no');
  }

  // ---- people and events
  function showPeople(f) {
    const body = $('people');
    const here = [...f.people].sort((a, b) => a.id - b.id);
    const alarms = new Set(f.events.map((e) => e.person));
    while (body.children.length > Math.max(here.length, 1)) body.lastChild.remove();
    if (!here.length) {
      const row = make('tr'), cell = make('td', 'empty', limited ? 'Sign in to see people.' : 'Nobody is inside.');
      cell.colSpan = 6;
      row.append(cell);
      return body.replaceChildren(row);
    }
    if (body.firstChild && body.firstChild.children.length < 6) body.replaceChildren();
    while (body.children.length < here.length) {
      const row = make('tr'), name = make('td'), button = make('button', 'who');
      button.type = 'button';
      button.append(make('i'), make('span'));
      button.addEventListener('click', () => choose(Number(button.dataset.person)));
      name.append(button);
      row.append(name, make('td'), make('td'), make('td', 'n'), make('td', 'n'), make('td', 'n'));
      body.append(row);
    }
    here.forEach((p, i) => {
      const row = body.children[i], cells = row.children, button = cells[0].firstChild;
      row.className = alarms.has(p.id) && f.events.some((e) => e.person === p.id && SERIOUS.has(e.kind)) ? 'alarm' : '';
      button.className = 'who c' + p.id % 8;
      button.dataset.person = p.id;
      button.setAttribute('aria-pressed', String(p.id === chosen));
      const texts = [`${p.id}`, view.zoneOf(p.position) || '\u2013', p.posture, `${p.height.toFixed(2)} m`,
        `${Math.hypot(...p.velocity).toFixed(1)} m/s`, p.since !== undefined ? duration(f.time - p.since) : '\u2013'];
      if (button.lastChild.textContent !== texts[0]) button.lastChild.textContent = texts[0];
      for (let k = 1; k < 6; ++k) if (cells[k].textContent !== texts[k]) cells[k].textContent = texts[k];
    });
  }

  function showEvents(f) {
    for (const entry of eventLog.values()) entry.going = false;
    for (const e of f.events) {
      const key = `${e.kind}/${e.person}/${Math.round(e.since)}`;
      const entry = eventLog.get(key) || { ...e };
      Object.assign(entry, { going: true, until: f.time, evidence: e.evidence });
      eventLog.set(key, entry);
    }
    while (eventLog.size > 40) eventLog.delete(eventLog.keys().next().value);
    const list = $('events'), shown = [...eventLog.values()].reverse();
    put('events-note', shown.length ? `${f.events.length} going on` : '\u00a0');
    const key = JSON.stringify(shown.map((e) => [e.kind, e.person, e.going, e.evidence, Math.round(e.since)]));
    if (list.dataset.key === key) return;
    list.dataset.key = key;
    if (!shown.length) return list.replaceChildren(make('li', 'empty', 'Nothing to report. Falls, people who do not move, crowding and things left behind appear here, with the evidence.'));
    list.replaceChildren(...shown.map((e) => {
      const item = make('li', (SERIOUS.has(e.kind) ? 'serious' : '') + (e.going ? '' : ' over'));
      item.append(make('b', '', (SAID[e.kind] || e.kind) + (e.person ? `, person ${e.person}` : '')), make('time', '', clockText(e.since)), make('p', '', e.evidence));
      return item;
    }));
  }

  function clockText(time) {
    if (clockOffset === null) return `at ${duration(time)}`;
    return new Date(1000 * (time + clockOffset)).toLocaleTimeString([], { hour12: false });
  }

  function onPeople(f) {
    frame = f;
    view.setPeople(f, seconds());
    showPeople(f);
    showEvents(f);
  }

  // Whoever stands before the page is to know that images are kept.
  function showRecording(r) {
    const on = r && r.state !== 'off';
    $('recording').hidden = !on;
    if (!on) return;
    $('recording').dataset.state = r.state;
    // In minutes, so that a screen reader does not read out every second; rounded as the verdict is.
    const minutes = Math.max(1, Math.round(r.ends_in_s / 60));
    put('recording', r.state === 'on'
      ? `Recording everything the sensors see, for ${minutes < 120 ? `${minutes} min` : duration(r.ends_in_s)} more`
      : 'A recording is on, but cannot be written');
  }

  function onState(s) {
    state = s;
    showHealth(s.health);
    // A unit that does not know the time is shown in this browser's.
    if (s.health.uptime_s !== null) clockOffset = (s.health.unix_time || Date.now() / 1000) - s.health.uptime_s;
    if (s.occupancy) showOccupancy(s.occupancy);
    if (s.sensors) showSensors(s.sensors);
    if (s.pipeline) showPipeline(s.pipeline);
    showRecording(s.pipeline && s.pipeline.recording);
    if (s.calibration) showCalibration(s.calibration);
    view.setState(s);
    describePlan();
  }

  function describePlan() {
    if (!state || !state.occupancy) return;
    const zones = state.occupancy.zones.map((z) => `${z.count} in ${z.name}`).join(', ');
    $('plan').setAttribute('aria-label', `Plan of the wagon: ${count(state.occupancy.count, 'person', 'people')}${zones ? ': ' + zones : ''}`);
  }

  // ---- the link
  function setLink(kind, words, veil) {
    document.body.dataset.link = kind;
    put('link', words);
    $('veil').hidden = !veil;
    if (veil) put('veil', veil);
  }
  function watchLink() {
    const silent = seconds() - heard;
    const age = state ? state.health.snapshot_age_s + silent : 0;
    if (heard < 0) setLink('connecting', 'connecting', '');
    else if (silent > STALE_S) {
      setLink('lost', 'no link', `Not live: the page has heard nothing for ${duration(silent)}. It keeps trying.`);
      document.body.dataset.verdict = 'unknown';
      put('verdict', 'No link to the unit');
      put('sentence', `Last heard ${duration(silent)} ago. What is shown below is from then; the page reconnects by itself.`);
    } else if (age > FRESH_AGE_S) setLink('stale', 'stale', `Not live: the unit has published nothing for ${duration(age)}.`);
    else setLink('live', limited ? 'counts' : 'live', '');
    if (clockOffset !== null && frame && document.body.dataset.link === 'live') put('clock', clockText(frame.time));
  }

  async function get(path, options) {
    const answer = await fetch(path, { cache: 'no-store', ...options });
    const body = await answer.json();
    if (!answer.ok) throw new Error(body.error || `status ${answer.status}`);
    return body;
  }

  let timer = 0, turn = 0;    // only the newest connect() goes on after it waited
  function after(wait_s, work) {
    clearTimeout(timer);
    timer = setTimeout(work, 1000 * wait_s);
  }
  function retry() {
    const wait = RETRY_S[Math.min(attempt++, RETRY_S.length - 1)];
    after(wait * (0.8 + 0.4 * Math.random()), connect);
  }

  async function connect() {
    const mine = ++turn;
    clearTimeout(timer);
    if (source) source.close();
    source = null;
    try {
      const [session, plan, version] = await Promise.all([get('/api/v1/session'), get('/api/v1/plan'), get('/api/v1/version')]);
      if (mine !== turn) return;
      if (JSON.stringify(plan) !== JSON.stringify(view.plan)) view.setPlan(plan);
      put('unit', plan.name || '');
      put('version', `wagonsight ${version.version}`);
      document.title = plan.name ? `${plan.name} \u00b7 wagonsight` : 'wagonsight';
      limited = session.scope === 'none';
      $('signin').hidden = !limited;
      if (limited) return poll();
    } catch (error) {
      if (mine === turn) retry();
      return;
    }
    source = new EventSource('/api/v1/events');
    const on = (name, work) => source.addEventListener(name, (message) => {
      heard = seconds();
      attempt = 0;
      work(JSON.parse(message.data));
    });
    on('people', onPeople);
    on('state', onState);
    source.onerror = () => { if (source) { source.close(); source = null; retry(); } };
  }

  // Without a token: what may be told to anybody, every two seconds.
  async function poll() {
    try {
      const [health, occupancy, sensors, calibration, pipeline] = await Promise.all(
        ['health', 'occupancy', 'sensors', 'calibration', 'pipeline'].map((name) => get('/api/v1/' + name)));
      heard = seconds();
      attempt = 0;
      onState({ health, occupancy, sensors: sensors.sensors, calibration, pipeline });
      showPeople({ time: 0, people: [], events: [] });
    } catch (error) {
      return retry();
    }
    after(2, poll);
  }

  $('signin-form').addEventListener('submit', async (event) => {
    event.preventDefault();
    put('signin-error', '');
    try {
      await get('/api/v1/session', { method: 'POST', headers: { Authorization: `Bearer ${$('token').value}` } });
      limited = false;
      $('token').value = '';
      connect();
    } catch (error) {
      put('signin-error', error.message);
    }
  });

  // A page that was asleep in a pocket looks for news at once.
  document.addEventListener('visibilitychange', () => {
    if (!document.hidden && seconds() - heard > STALE_S) { attempt = 0; connect(); }
  });
  setInterval(watchLink, 500);
  function picture() {
    if (!document.hidden) view.tick(seconds(), !calm.matches);
    requestAnimationFrame(picture);
  }
  showEvents({ time: 0, events: [] });
  requestAnimationFrame(picture);
  connect();
})();
