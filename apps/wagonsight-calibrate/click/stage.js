'use strict';
// The image with what is drawn on it: zoom, pan, corners, prediction, outlines, magnifier.
const el = (id) => document.getElementById(id);

class Stage {
  constructor(canvas, magnifier) {
    this.canvas = canvas;
    this.magnifier = magnifier;
    this.image = null;
    this.scale = 1; this.left = 0; this.top = 0;  // screen = scale * (pixel + 0.5) + (left, top)
    this.scene = { corners: [], predicted: [], balls: [], columns: 1 };
    this.cursor = null;  // in pixels of the image
    new ResizeObserver(() => { const fitted = this.fitted; this.resize(); if (fitted) this.fit(); }).observe(canvas);
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.draw());
    this.resize();
  }
  resize() {
    const box = this.canvas.getBoundingClientRect(), ratio = devicePixelRatio || 1;
    this.width = box.width; this.height = box.height; this.ratio = ratio;
    this.canvas.width = Math.max(1, Math.round(box.width * ratio));
    this.canvas.height = Math.max(1, Math.round(box.height * ratio));
    this.draw();
  }
  show(image) { this.image = image; this.cursor = null; this.fit(); }
  fit() {
    if (!this.image) return this.draw();
    const pad = 14;
    this.scale = Math.min((this.width - 2 * pad) / this.image.width, (this.height - 2 * pad) / this.image.height);
    this.left = (this.width - this.scale * this.image.width) / 2;
    this.top = (this.height - this.scale * this.image.height) / 2;
    this.fitted = true;
    this.draw();
  }
  zoom(factor, x = this.width / 2, y = this.height / 2) {
    const scale = Math.min(60, Math.max(0.1, this.scale * factor)), real = scale / this.scale;
    this.left = x - (x - this.left) * real; this.top = y - (y - this.top) * real;
    this.scale = scale; this.fitted = false;
    this.draw();
  }
  pan(dx, dy) { this.left += dx; this.top += dy; this.fitted = false; this.draw(); }
  toPixel(x, y) { return { x: (x - this.left) / this.scale - 0.5, y: (y - this.top) / this.scale - 0.5 }; }
  toScreen(p) { return { x: this.left + this.scale * (p.x + 0.5), y: this.top + this.scale * (p.y + 0.5) }; }
  // Brings a pixel into sight.
  reveal(p) {
    const s = this.toScreen(p), margin = 40;
    const dx = s.x < margin ? margin - s.x : s.x > this.width - margin ? this.width - margin - s.x : 0;
    const dy = s.y < margin ? margin - s.y : s.y > this.height - margin ? this.height - margin - s.y : 0;
    if (dx || dy) this.pan(dx, dy);
  }
  draw() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => { this.waiting = false; this.paint(); });
  }
  paint() {
    const g = this.canvas.getContext('2d');
    g.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    g.clearRect(0, 0, this.width, this.height);
    if (!this.image) return;
    g.imageSmoothingEnabled = this.scale < 2;
    g.drawImage(this.image, this.left, this.top, this.scale * this.image.width, this.scale * this.image.height);
    this.paintRows(g);
    const arm = Math.max(5, Math.min(11, this.scale * 3));
    for (const corner of this.scene.predicted) this.paintPredicted(g, corner, arm);
    for (const corner of this.scene.corners) this.paintCorner(g, corner, arm);
    for (const ball of this.scene.balls) this.paintBall(g, ball);
    if (this.cursor && this.scene.crosshair) this.paintCrosshair(g, this.toScreen(this.cursor));
    this.paintMagnifier();
  }
  // A thin line along each row of IDs shows at a glance whether they run as they should.
  paintRows(g) {
    let before = null;
    g.lineWidth = 1.2;
    for (const corner of this.scene.corners) {
      const row = Math.floor(corner.id / this.scene.columns), s = this.toScreen(corner);
      if (before && before.row === row) {
        g.strokeStyle = `hsl(${(row * 47) % 360} 90% 60% / .75)`;
        g.beginPath(); g.moveTo(before.s.x, before.s.y); g.lineTo(s.x, s.y); g.stroke();
      }
      before = { row, s };
    }
  }
  paintPredicted(g, corner, arm) {
    const s = this.toScreen(corner);
    g.setLineDash([3, 2.5]); g.lineWidth = 1.6;
    g.strokeStyle = corner.chosen ? '#22d3ee' : '#fbbf24';
    g.beginPath(); g.arc(s.x, s.y, arm * 0.75, 0, 7); g.stroke(); g.setLineDash([]);
    if (this.scale > 2.2 || corner.chosen) this.label(g, corner.id, s, arm, '#fbbf24');
  }
  paintCorner(g, corner, arm) {
    const s = this.toScreen(corner), colour = corner.misfit ? '#ff5a4d' : corner.chosen ? '#22d3ee' : '#34e07a';
    for (const [width, stroke] of [[3.4, 'rgb(0 0 0 / .55)'], [1.5, colour]]) {
      g.lineWidth = width; g.strokeStyle = stroke;
      g.beginPath(); g.arc(s.x, s.y, arm, 0, 7);
      g.moveTo(s.x - arm, s.y); g.lineTo(s.x - 2.5, s.y); g.moveTo(s.x + 2.5, s.y); g.lineTo(s.x + arm, s.y);
      g.moveTo(s.x, s.y - arm); g.lineTo(s.x, s.y - 2.5); g.moveTo(s.x, s.y + 2.5); g.lineTo(s.x, s.y + arm);
      g.stroke();
    }
    const corners = corner.id === 0 || corner.chosen || corner.misfit;
    if (this.scale > 1.8 || corners) this.label(g, corner.id, s, arm, colour);
  }
  paintBall(g, ball) {
    const s = this.toScreen(ball), colour = ball.chosen ? '#22d3ee' : '#f0abfc';
    const [a, b, angle, x = ball.x, y = ball.y] = ball.outline || [6 / this.scale, 6 / this.scale, 0];
    const middle = this.toScreen({ x, y });
    for (const [width, stroke] of [[3.6, 'rgb(0 0 0 / .5)'], [1.7, colour]]) {
      g.lineWidth = width; g.strokeStyle = stroke;
      g.beginPath(); g.ellipse(middle.x, middle.y, a * this.scale, b * this.scale, angle, 0, 7); g.stroke();
      g.beginPath(); g.moveTo(s.x - 4, s.y); g.lineTo(s.x + 4, s.y); g.moveTo(s.x, s.y - 4); g.lineTo(s.x, s.y + 4); g.stroke();
    }
    this.label(g, ball.id, s, a * this.scale, colour);
  }
  label(g, text, s, arm, colour) {
    g.font = '600 12px system-ui, sans-serif';
    g.lineWidth = 3; g.strokeStyle = 'rgb(0 0 0 / .75)'; g.fillStyle = colour;
    g.strokeText(text, s.x + arm + 2, s.y - arm + 3); g.fillText(text, s.x + arm + 2, s.y - arm + 3);
  }
  paintCrosshair(g, s) {
    g.lineWidth = 1; g.strokeStyle = 'rgb(34 211 238 / .9)';
    g.beginPath(); g.moveTo(s.x - 18, s.y); g.lineTo(s.x + 18, s.y); g.moveTo(s.x, s.y - 18); g.lineTo(s.x, s.y + 18); g.stroke();
  }
  paintMagnifier() {
    const canvas = this.magnifier, g = canvas.getContext('2d'), size = canvas.width, zoom = 9;
    g.fillStyle = '#000'; g.fillRect(0, 0, size, size);
    const at = this.scene.focus || this.cursor;
    if (!at || !this.image) return;
    const half = size / zoom / 2;
    g.imageSmoothingEnabled = false;
    g.drawImage(this.image, at.x + 0.5 - half, at.y + 0.5 - half, 2 * half, 2 * half, 0, 0, size, size);
    const place = (p) => [(p.x - at.x) * zoom + size / 2, (p.y - at.y) * zoom + size / 2];
    for (const corner of this.scene.corners) {
      const [x, y] = place(corner);
      if (Math.abs(x - size / 2) > size || Math.abs(y - size / 2) > size) continue;
      g.strokeStyle = '#34e07a'; g.lineWidth = 2;
      g.beginPath(); g.arc(x, y, 7, 0, 7); g.moveTo(x - 12, y); g.lineTo(x + 12, y); g.moveTo(x, y - 12); g.lineTo(x, y + 12); g.stroke();
    }
    g.strokeStyle = 'rgb(34 211 238 / .9)'; g.lineWidth = 1;
    g.beginPath(); g.moveTo(size / 2, 0); g.lineTo(size / 2, size); g.moveTo(0, size / 2); g.lineTo(size, size / 2); g.stroke();
  }
}
