// The drawing of the machine that moves. Python sends where the parts are in every frame; this only draws them, in true
// time, thirty pictures a second: one move as a shadow behind the other, or both beside each other. What is uncertain is
// drawn at both of its ends, too: small at the low one, large at the high one.
"use strict";
class JshapeScene {
  PAUSE = 1000 / 30 - 4;
  // Milliseconds after a slider's movement, when the curves come first, and between two pictures then.
  MOVING = 200;
  SELDOM = 100;
  drawn = 0;
  moved = -Infinity;
  data = null;
  at = 0;
  playing = !matchMedia("(prefers-reduced-motion: reduce)").matches;
  last = null;
  colours = { unshaped: "#b9855f", shaped: "#0072b2", low: "#009e73", high: "#a65a8e", dark: "#444", line: "#999" };
  sizes = { low: 0.6, high: 1.4 };
  size = 1;

  constructor(name) {
    this.name = name;
  }
  part(name) {
    return document.getElementById(`${this.name}-${name}`);
  }
  paint(dark) {
    this.colours.dark = dark ? "#bbb" : "#444";
    this.colours.line = dark ? "#777" : "#999";
    this.draw();
  }

  set(data) {
    this.data = data;
    const note = this.part("note");
    if (note) note.textContent = data.note ?? "";
    if (!this.running) { this.running = true; requestAnimationFrame((now) => this.step(now)); }
    if (!this.playing) this.draw();
  }
  toggle(button) {
    this.playing = !this.playing;
    button.textContent = this.playing ? button.dataset.pause : button.dataset.play;
  }
  scrub(share) {
    if (!this.data) return;
    this.at = share * this.data.times[this.data.times.length - 1];
    this.playing = false;
    this.part("play").textContent = this.part("play").dataset.play;
    this.draw();
  }
  step(now) {
    const end = this.data.times[this.data.times.length - 1];
    if (this.playing && this.last !== null) {
      // A second of rest between two rounds.
      this.at = (this.at + (now - this.last) / 1000) % (end + 1);
      const pause = now - this.moved < this.MOVING ? this.SELDOM : this.PAUSE;
      if (now - this.drawn >= pause) { this.drawn = now; this.draw(); }
    }
    this.last = now;
    requestAnimationFrame((later) => this.step(later));
  }
  draw() {
    const canvas = document.getElementById(this.name);
    if (!canvas || !canvas.clientWidth || !this.data) return;
    const { times, kind, places, view } = this.data, end = times[times.length - 1];
    const time = Math.min(this.at, end), frame = Math.round((time / end) * (times.length - 1));
    const scale = window.devicePixelRatio || 1, wide = canvas.clientWidth, high = canvas.clientHeight;
    if (canvas.width !== Math.round(wide * scale)) { canvas.width = wide * scale; canvas.height = high * scale; }
    const pen = canvas.getContext("2d");
    pen.setTransform(scale, 0, 0, scale, 0, 0);
    pen.clearRect(0, 0, wide, high);
    const shapes = Object.keys(places), halves = this.data.titles ? this.halves(view, wide, high) : null;
    shapes.forEach((name, i) => {
      const [x0, y0, w, h] = halves ? halves[i] : [0, 0, wide, high];
      const [left, right, low, top] = view, size = Math.min(w / (right - left), h / (top - low));
      const x = (v) => x0 + w / 2 + (v - (left + right) / 2) * size;
      const y = (v) => y0 + h / 2 - (v - (low + top) / 2) * size;
      pen.globalAlpha = 1;
      pen.lineWidth = 2;
      pen.strokeStyle = this.colours.line;
      if ((kind === "crane" || kind === "masses") && (halves || i === 0)) this.path(pen, [[x0, y(0)], [x0 + w, y(0)]]);
      if (halves) this.title(pen, this.data.titles[i], x0 + 4, y0 + 14);
      else pen.globalAlpha = name === "shaped" || name === "low" ? 1 : 0.55;
      this.size = this.sizes[name] ?? 1;
      this[kind](pen, places[name][frame], x, y, this.colours[name], places[name]);
    });
    pen.globalAlpha = 1;
    this.part("time").textContent = `${time.toFixed(1)} / ${end.toFixed(1)} s`;
    const slider = this.part("at");
    if (document.activeElement !== slider || this.playing) slider.value = String(Math.round((1000 * time) / end));
  }
  halves([left, right, low, top], wide, high) {
    const flat = (right - left) * high > 1.2 * (top - low) * wide;
    return flat
      ? [[0, 0, wide, high / 2], [0, high / 2, wide, high / 2]]
      : [[0, 0, wide / 2, high], [wide / 2, 0, wide / 2, high]];
  }
  title(pen, words, x, y) {
    pen.fillStyle = this.colours.dark;
    pen.font = "600 13px sans-serif";
    pen.fillText(words, x, y);
  }
  path(pen, points) {
    pen.beginPath();
    points.forEach(([a, b], i) => (i ? pen.lineTo(a, b) : pen.moveTo(a, b)));
    pen.stroke();
  }
  goal(pen, points) {
    // Of an episode every move has another one.
    if (this.data.titles) return;
    pen.strokeStyle = this.colours.line;
    pen.lineWidth = 1;
    pen.setLineDash([3, 4]);
    this.path(pen, points);
    pen.setLineDash([]);
  }
  disc(pen, a, b, radius, colour) {
    pen.fillStyle = colour;
    pen.beginPath();
    pen.arc(a, b, radius * this.size, 0, 2 * Math.PI);
    pen.fill();
  }
  crane(pen, now, x, y, colour) {
    pen.strokeStyle = this.colours.dark;
    pen.lineWidth = 1.5;
    this.path(pen, now.map(([a, b]) => [x(a), y(b)]));
    pen.fillStyle = this.colours.dark;
    pen.fillRect(x(now[0][0]) - 14, y(now[0][1]) - 5, 28, 10);
    now.slice(1).forEach(([a, b], i) => this.disc(pen, x(a), y(b), i === now.length - 2 ? 9 : 5, colour));
  }
  tank(pen, now, x, y, colour) {
    const at = now.map(([a, b]) => [x(a), y(b)]), opaque = pen.globalAlpha;
    pen.strokeStyle = this.colours.dark;
    pen.lineWidth = 2;
    this.path(pen, at.slice(0, 4));
    pen.strokeStyle = pen.fillStyle = colour;
    this.path(pen, at.slice(4));
    pen.globalAlpha = 0.3 * opaque;
    pen.beginPath();
    [...at.slice(1, 3), ...at.slice(4)].forEach(([a, b], i) => (i ? pen.lineTo(a, b) : pen.moveTo(a, b)));
    pen.fill();
    pen.globalAlpha = opaque;
  }
  bodies(pen, now, x, y, colour) {
    const at = now.map(([a, b]) => [x(a), y(b)]);
    pen.strokeStyle = this.colours.dark;
    for (let i = 0; i < at.length; i += 2) this.path(pen, at.slice(i, i + 2));
    for (let i = 1; i < at.length; i += 2) this.disc(pen, ...at[i], i > at.length / 2 ? 6 : 3, colour);
  }
  above(pen, now, x, y, colour) {
    pen.strokeStyle = this.colours.dark;
    pen.lineWidth = 3;
    this.path(pen, now.slice(0, -1).map(([a, b]) => [x(a), y(b)]));
    pen.lineWidth = 1;
    this.path(pen, now.slice(-2).map(([a, b]) => [x(a), y(b)]));
    pen.fillStyle = this.colours.dark;
    const [held, load] = now.slice(-2);
    now.slice(0, -2).forEach(([a, b]) => this.disc(pen, x(a), y(b), 8, this.colours.dark));
    pen.fillRect(x(held[0]) - 6, y(held[1]) - 6, 12, 12);
    this.disc(pen, x(load[0]), y(load[1]), 8, colour);
  }
  masses(pen, now, x, y, colour, all) {
    const gap = this.data.gap, base = x(now[0][0]), load = x(now[1][0] + gap), floor = y(0);
    const goal = x(all[all.length - 1][0][0] + gap);
    this.goal(pen, [[goal, floor], [goal, floor - 70]]);
    pen.strokeStyle = this.colours.dark;
    const spring = [...Array(14).keys()].map((i) => {
      const side = i === 0 || i === 13 ? 0 : i % 2 ? 8 : -8;
      return [base + ((load - base) * i) / 13, floor - 20 + side];
    });
    this.path(pen, spring);
    pen.fillStyle = this.colours.dark;
    pen.fillRect(base - 14, floor - 36, 28, 36);
    pen.fillStyle = colour;
    pen.fillRect(load - 22 * this.size, floor - 46 * this.size, 44 * this.size, 46 * this.size);
  }
  link(pen, [motor, tip], x, y, colour, all) {
    const goal = all[all.length - 1][0];
    this.goal(pen, [[x(0), y(0)], [x(1.15 * Math.cos(goal)), y(1.15 * Math.sin(goal))]]);
    pen.strokeStyle = this.colours.dark;
    pen.lineWidth = 4;
    const along = [...Array(20).keys()].map((i) => {
      const s = i / 19, angle = motor + (tip - motor) * s;
      return [x(s * Math.cos(angle)), y(s * Math.sin(angle))];
    });
    this.path(pen, along);
    this.disc(pen, x(0), y(0), 10, this.colours.dark);
    this.disc(pen, x(Math.cos(tip)), y(Math.sin(tip)), 9, colour);
  }
}
const jshapeScene = new JshapeScene("scene"), jshapeEpisode = new JshapeScene("episode");
