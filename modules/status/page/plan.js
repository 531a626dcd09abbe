'use strict';
// Draws the wagon from above. World metres go to screen pixels by `place`: along the page on wide
// screens, down the page on narrow ones, never mirrored.

const SVG = 'http://www.w3.org/2000/svg';
const TRAIL_S = 6;          // how much of a person's way is shown
const DELAY_S = 0.15;       // drawn that much behind the newest frame, so that motion is smooth
const SURE_MAX_M = 0.4;     // the ring of uncertainty grows no larger
const ARROW_S = 0.7;        // an arrow shows where a person is that much later

function shape(parent, name, attributes, text) {
  const node = document.createElementNS(SVG, name);
  for (const key in attributes) node.setAttribute(key, attributes[key]);
  if (text !== undefined) node.textContent = text;
  if (parent) parent.append(node);
  return node;
}

class PlanView {
  constructor(svg, onChoose) {
    this.svg = svg;
    this.onChoose = onChoose;
    this.plan = null;
    this.people = new Map();
    this.chosen = 0;
    this.state = null;
    this.width = 0;
    new ResizeObserver(() => this.layout()).observe(svg.parentElement);
    // A page without the plan keeps the place of a usual wagon free.
    this.svg.setAttribute('viewBox', '0 0 600 300');
  }

  setPlan(plan) {
    this.plan = plan;
    this.width = 0;
    this.layout();
  }

  layout() {
    const width = Math.round(this.svg.parentElement.clientWidth);
    if (!this.plan || width === 0 || width === this.width) return;
    this.width = width;
    const { min, max } = this.plan.inside;
    const length = Math.max(max[0] - min[0], 0.5), breadth = Math.max(max[1] - min[1], 0.5);
    this.upright = width < 560;
    this.narrow = width < 300;  // no room for the doors' counts; they stand in the list
    if (this.upright) {
      const side = this.narrow ? 62 : 90, scale = Math.min((width - 2 * side) / breadth, 150);
      const left = (width - scale * breadth) / 2;
      this.height = Math.ceil(scale * length + 48);
      this.place = ([x, y]) => [left + scale * (y - min[1]), 24 + scale * (x - min[0])];
      this.turn = (yaw) => Math.PI / 2 - yaw;
      this.scale = scale;
    } else {
      const side = 14, scale = Math.min((width - 2 * side) / length, 190);
      const left = (width - scale * length) / 2;
      this.height = Math.ceil(scale * breadth + 88);
      this.place = ([x, y]) => [left + scale * (x - min[0]), 58 + scale * (max[1] - y)];
      this.turn = (yaw) => -yaw;
      this.scale = scale;
    }
    this.turnDegrees = (yaw) => this.turn(yaw) * 180 / Math.PI;
    this.svg.setAttribute('viewBox', `0 0 ${width} ${this.height}`);
    this.draw();
  }

  draw() {
    this.svg.textContent = '';
    this.labels = [];
    this.drawBody();
    this.drawZones();
    this.drawGlass();
    this.drawDoors();
    this.drawSensors();
    this.drawSeats();
    this.trails = shape(this.svg, 'g');
    this.figures = shape(this.svg, 'g');
    for (const person of this.people.values()) this.makeFigure(person);
    if (this.state) this.setState(this.state);
  }

  box(a, b) {
    const [p, q] = [this.place(a), this.place(b)];
    return { x: Math.min(p[0], q[0]), y: Math.min(p[1], q[1]),
             width: Math.abs(p[0] - q[0]), height: Math.abs(p[1] - q[1]) };
  }

  drawBody() {
    const { min, max } = this.plan.inside;
    const box = this.box(min, max);
    const clip = shape(shape(this.svg, 'defs'), 'clipPath', { id: 'inside' });
    shape(clip, 'rect', { ...box, rx: 10 });
    shape(this.svg, 'rect', { x: box.x - 2.5, y: box.y - 2.5, width: box.width + 5,
                              height: box.height + 5, rx: 12, class: 's-wall' });
  }

  drawZones() {
    this.zones = new Map();
    const used = [];
    this.plan.zones.forEach((zone, index) => {
      const corners = zone.polygon.map((p) => this.place(p));
      const points = corners.map((p) => p.map((v) => v.toFixed(1)).join()).join(' ');
      shape(this.svg, 'polygon', { points, class: 's-zone' + (index % 2 ? ' alt' : ''),
                                   'clip-path': 'url(#inside)' });
      if (index) shape(this.svg, 'polygon', { points, class: 's-zone-line', 'clip-path': 'url(#inside)' });
      const xs = corners.map((p) => p[0]), ys = corners.map((p) => p[1]);
      const mid = [(Math.min(...xs) + Math.max(...xs)) / 2, (Math.min(...ys) + Math.max(...ys)) / 2];
      const at = this.zoneLabelPlace(mid, used);
      const anchor = this.upright ? 'end' : 'middle';
      this.drawBracket(at, xs, ys);
      const label = shape(this.svg, 'text', { x: at[0], y: at[1], 'text-anchor': anchor });
      shape(label, 'tspan', { class: 's-zone-name' }, zone.name);
      const count = shape(label, 'tspan', this.upright
        ? { class: 's-zone-count', x: at[0], dy: 16 } : { class: 's-zone-count', dx: 7 }, '');
      this.zones.set(zone.name, { count, polygon: zone.polygon });
    });
  }

  // A thin line along the zone's extent, between its label and the wagon.
  drawBracket(at, xs, ys) {
    const gap = 5, tick = 4;
    const [a, b] = this.upright ? [Math.min(...ys) + gap, Math.max(...ys) - gap] : [Math.min(...xs) + gap, Math.max(...xs) - gap];
    const away = this.upright ? at[0] + 6 : at[1] + 8;
    shape(this.svg, 'path', { class: 's-bracket', d: this.upright
      ? `M${away + tick} ${a}H${away}V${b}H${away + tick}` : `M${a} ${away + tick}V${away}H${b}V${away + tick}` });
  }

  // Beside the wagon, so that nobody walks over it; on the other side where one is there already.
  zoneLabelPlace(mid, used) {
    const { min, max } = this.plan.inside;
    const box = this.box(min, max), side = this.narrow ? 56 : 90;
    const spots = this.upright
      ? [[box.x - (this.narrow ? 14 : 48), mid[1]], [box.x + box.width + side, mid[1]]]
      : [[mid[0], box.y - 38], [mid[0], box.y + box.height + 25]];
    const free = spots.find((s) => used.every((u) => Math.hypot(u[0] - s[0], u[1] - s[1]) > 60));
    used.push(free || spots[0]);
    return free || spots[0];
  }

  drawGlass() {
    const { min, max } = this.plan.inside;
    for (const mask of this.plan.masks) {
      // Only what lies at a wall is a line in it; anything else stays an outline.
      const a = [Math.max(mask.min[0], min[0]), Math.max(mask.min[1], min[1])];
      const b = [Math.min(mask.max[0], max[0]), Math.min(mask.max[1], max[1])];
      const along = b[0] - a[0] > b[1] - a[1];
      const low = along ? a[1] - min[1] < max[1] - b[1] : a[0] - min[0] < max[0] - b[0];
      const wall = along ? (low ? min[1] : max[1]) : (low ? min[0] : max[0]);
      const p = this.place(along ? [a[0], wall] : [wall, a[1]]);
      const q = this.place(along ? [b[0], wall] : [wall, b[1]]);
      const line = shape(this.svg, 'line', { x1: p[0], y1: p[1], x2: q[0], y2: q[1], class: 's-glass' });
      shape(line, 'title', {}, mask.name);
    }
  }

  drawDoors() {
    this.doors = new Map();
    const { min, max } = this.plan.inside;
    for (const door of this.plan.doors) {
      const p = this.place(door.from), q = this.place(door.to);
      const line = { x1: p[0], y1: p[1], x2: q[0], y2: q[1] };
      shape(this.svg, 'line', { ...line, class: 's-door-gap' });
      for (const [u, v] of [[0.03, 0.47], [0.53, 0.97]]) {  // two leaves
        shape(this.svg, 'line', { class: 's-door',
          x1: p[0] + u * (q[0] - p[0]), y1: p[1] + u * (q[1] - p[1]),
          x2: p[0] + v * (q[0] - p[0]), y2: p[1] + v * (q[1] - p[1]) });
      }
      const mid = [(p[0] + q[0]) / 2, (p[1] + q[1]) / 2];
      const high = (door.from[1] + door.to[1]) / 2 > (min[1] + max[1]) / 2;
      const at = this.upright
        ? { x: mid[0] + (high ? 9 : -9), y: mid[1] + 4, 'text-anchor': high ? 'start' : 'end' }
        : { x: mid[0], y: mid[1] + (high ? -11 : 21), 'text-anchor': 'middle' };
      const label = shape(this.svg, 'text', { ...at, class: 's-door-name' }, this.upright ? '' : door.name);
      this.doors.set(door.name, { label, name: door.name });
    }
  }

  drawSeats() {
    this.seats = new Map();
    for (const seat of this.plan.seats) {
      const [x, y] = this.place(seat.position);
      const w = seat.width * this.scale * 0.94, d = 0.45 * this.scale;
      const group = shape(this.svg, 'g', { class: 's-seat' });
      const turned = shape(group, 'g', { transform: `translate(${x.toFixed(1)} ${y.toFixed(1)}) rotate(${this.turnDegrees(seat.yaw).toFixed(1)})` });
      shape(turned, 'rect', { x: -d / 2, y: -w / 2, width: d, height: w, rx: 6 });
      shape(turned, 'rect', { x: -d / 2, y: -w / 2, width: d * 0.2, height: w, rx: 3, class: 'back' });
      shape(group, 'text', { x, y }, seat.name.length <= 4 ? seat.name : '');
      this.seats.set(seat.name, { group, title: shape(group, 'title', {}, seat.name) });
    }
  }

  drawSensors() {
    this.sensors = new Map();
    for (const sensor of this.plan.sensors) {
      const [x, y] = this.place(sensor.position);
      const yaw = this.turn(Math.atan2(sensor.looks[1], sensor.looks[0]));
      const looks = Math.hypot(...sensor.looks) > 0.01;
      const reach = sensor.range * this.scale, half = sensor.view_angle / 2;
      const end = (angle, r) => `${(x + r * Math.cos(angle)).toFixed(1)} ${(y + r * Math.sin(angle)).toFixed(1)}`;
      const view = shape(this.svg, 'path', { class: 's-view', 'clip-path': 'url(#inside)', d: looks
        ? `M${x} ${y}L${end(yaw - half, reach)}A${reach} ${reach} 0 0 1 ${end(yaw + half, reach)}Z` : '' });
      const group = shape(this.svg, 'g', { class: 's-sensor' });
      if (looks) shape(group, 'path', { d: `M${end(yaw, 15)}L${end(yaw + 0.6, 9)}L${end(yaw - 0.6, 9)}Z` });
      shape(group, 'circle', { cx: x, cy: y, r: 9.5 });
      shape(group, 'text', { x, y: y + 0.5 }, sensor.name.length <= 3 ? sensor.name : '');
      this.sensors.set(sensor.name, { group, view, title: shape(group, 'title', {}, sensor.name) });
    }
  }

  // Zones, seats, doors and sensors: about once a second.
  setState(state) {
    this.state = state;
    if (!this.plan || !this.place) return;
    const occupancy = state.occupancy;
    for (const zone of occupancy ? occupancy.zones : []) {
      const drawn = this.zones.get(zone.name);
      if (drawn) drawn.count.textContent = zone.capacity ? `${zone.count} / ${zone.capacity}` : `${zone.count}`;
    }
    for (const seat of occupancy ? occupancy.seats : []) {
      const drawn = this.seats.get(seat.name);
      if (!drawn) continue;
      drawn.group.setAttribute('class', 's-seat ' + seat.state);
      drawn.title.textContent = `${seat.name}: ${seat.state === 'unobserved' ? 'not seen' : seat.state}`;
    }
    for (const door of occupancy ? occupancy.doors : []) {
      const drawn = this.doors.get(door.name);
      if (!drawn) continue;
      drawn.label.textContent = this.upright ? '' : `${door.name}  \u00b7  ${door.boarded} in, ${door.alighted} out`;
      if (this.upright && !this.narrow) {
        [`${door.boarded} in`, `${door.alighted} out`].forEach((text, line) => {
          shape(drawn.label, 'tspan', { x: drawn.label.getAttribute('x'), dy: line ? 15 : -8 }, text);
        });
      }
    }
    for (const sensor of state.sensors || []) {
      const drawn = this.sensors.get(sensor.name);
      if (!drawn) continue;
      drawn.group.setAttribute('class', 's-sensor ' + sensor.state);
      drawn.view.setAttribute('class', 's-view ' + sensor.state);
      drawn.title.textContent = `${sensor.name}: ${sensor.state}, ${sensor.fps.toFixed(1)} frames a second`;
    }
  }

  makeFigure(person) {
    const tone = 'c' + person.id % 8;
    person.trail = shape(this.trails, 'path', { class: 's-trail ' + tone });
    person.group = shape(this.figures, 'g', { class: 's-person ' + tone, 'data-person': person.id });
    person.sure = shape(person.group, 'ellipse', { class: 'sure' });
    person.arrow = shape(person.group, 'path', { class: 'arrow' });
    person.ring = shape(person.group, 'rect', { class: 'ring' });
    person.body = shape(person.group, 'rect', { class: 'body' });
    shape(person.group, 'text', { class: 'id' }, String(person.id));
    person.tall = shape(person.group, 'text', { class: 'tall' });
    person.group.addEventListener('click', () => this.onChoose(person.id));
    if (person.last) this.dress(person);
  }

  // Standing is a disc, sitting a rounded square, lying a capsule along the body's box.
  dress(person) {
    const last = person.last;
    const r = Math.max(9, Math.min(0.19 * this.scale, 17));
    const [half, high, round] = { standing: [r, r, r], sitting: [r * 0.92, r * 0.92, r * 0.34],
      lying: [Math.max(1.9 * r, 0.36 * this.scale), r * 0.72, r * 0.72] }[last.posture] || [r, r, r];
    const yaw = last.posture === 'lying' && last.box
      ? this.turnDegrees(last.box.yaw + (last.box.size[1] > last.box.size[0] ? Math.PI / 2 : 0)) : 0;
    for (const node of [person.body, person.ring]) {
      const grow = node === person.ring ? 4 : 0;
      const set = { x: -half - grow, y: -high - grow, width: 2 * (half + grow),
                    height: 2 * (high + grow), rx: round + grow, transform: `rotate(${yaw.toFixed(1)})` };
      for (const key in set) node.setAttribute(key, set[key]);
    }
    person.sure.setAttribute('transform', `rotate(${yaw.toFixed(1)})`);
    const [sx, sy] = this.upright ? [last.sigma[1], last.sigma[0]] : last.sigma;
    const doubt = (sigma) => Math.min(2 * sigma, SURE_MAX_M) * this.scale;
    person.sure.setAttribute('rx', (half + doubt(sx)).toFixed(1));
    person.sure.setAttribute('ry', (high + doubt(sy)).toFixed(1));
    person.tall.textContent = `${last.height.toFixed(2)} m`;
    person.tall.setAttribute('y', (high + 14).toFixed(1));
    const crowded = this.people.size > 14 && person.id !== this.chosen;
    person.tall.setAttribute('visibility', crowded ? 'hidden' : 'visible');
    const classes = ['s-person', 'c' + person.id % 8];
    if (person.alarm) classes.push('alarm');
    if (person.id === this.chosen) classes.push('chosen');
    if (person.coasting) classes.push('coasting');
    person.group.setAttribute('class', classes.join(' '));
  }

  // A new frame. `now` is the page's clock in seconds.
  setPeople(frame, now) {
    const alarms = new Set(frame.events.filter((e) => e.person && (e.kind === 'fall' || e.kind === 'motionless')).map((e) => e.person));
    const present = new Set();
    for (const told of frame.people) {
      present.add(told.id);
      let person = this.people.get(told.id);
      if (!person) {
        person = { id: told.id, way: [] };
        this.people.set(told.id, person);
        if (this.figures) this.makeFigure(person);
      }
      person.last = { ...told, sigma: told.sigma || [0, 0] };
      person.alarm = alarms.has(told.id);
      person.coasting = told.last_seen !== undefined && frame.time - told.last_seen > 0.3;
      person.way.push([now, told.position[0], told.position[1]]);
      while (person.way.length > 2 && person.way[1][0] < now - TRAIL_S) person.way.shift();
      if (person.group) this.dress(person);
    }
    for (const [id, person] of this.people) {
      if (present.has(id)) continue;
      if (person.group) { person.group.remove(); person.trail.remove(); }
      this.people.delete(id);
    }
  }

  choose(id) {
    this.chosen = id;
    for (const person of this.people.values()) if (person.group) this.dress(person);
  }

  // Moves the figures; called for every picture the browser shows.
  tick(now, smooth) {
    if (!this.place) return;
    for (const person of this.people.values()) {
      if (!person.group) continue;
      const [x, y] = this.place(smooth ? at(person.way, now - DELAY_S) : person.way[person.way.length - 1].slice(1));
      person.group.setAttribute('transform', `translate(${x.toFixed(2)} ${y.toFixed(2)})`);
      this.drawArrow(person);
      if (person.told !== person.way.length + person.way[0][0]) this.drawTrail(person, x, y);
    }
  }

  drawArrow(person) {
    const [vx, vy] = person.last.velocity;
    if (Math.hypot(vx, vy) < 0.15) return person.arrow.setAttribute('d', '');
    const yaw = this.turn(Math.atan2(vy, vx));
    const from = Math.max(9, Math.min(0.19 * this.scale, 17)) + 4;
    const to = from + Math.max(8, Math.hypot(vx, vy) * ARROW_S * this.scale * 0.6);
    const point = (r, a) => `${(r * Math.cos(a)).toFixed(1)} ${(r * Math.sin(a)).toFixed(1)}`;
    person.arrow.setAttribute('d', `M${point(from, yaw)}L${point(to, yaw)}M${point(to - 6, yaw + 5 / to)}L${point(to, yaw)}L${point(to - 6, yaw - 5 / to)}`);
  }

  drawTrail(person, x, y) {
    const points = person.way.slice(0, -1).map((w) => this.place([w[1], w[2]]).map((v) => v.toFixed(1)).join(' '));
    points.push(`${x.toFixed(1)} ${y.toFixed(1)}`);
    person.trail.setAttribute('d', 'M' + points.join('L'));
  }

  zoneOf(position) {
    if (!this.plan) return '';
    const zone = this.plan.zones.find((z) => within(z.polygon, position));
    return zone ? zone.name : '';
  }
}

// The place on a way [[time, x, y], ...] at a time, linear between its points.
function at(way, time) {
  for (let i = way.length - 1; i > 0; --i) {
    const a = way[i - 1], b = way[i];
    if (time < a[0]) continue;
    const share = Math.min(1, (time - a[0]) / Math.max(1e-3, b[0] - a[0]));
    return [a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2])];
  }
  return [way[0][1], way[0][2]];
}

function within(polygon, [x, y]) {
  let inside = false;
  for (let i = 0, j = polygon.length - 1; i < polygon.length; j = i++) {
    const [xi, yi] = polygon[i], [xj, yj] = polygon[j];
    if ((yi > y) !== (yj > y) && x < xi + (y - yi) * (xj - xi) / (yj - yi)) inside = !inside;
  }
  return inside;
}
