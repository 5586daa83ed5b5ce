// The runs over time: measured and models overlaid, residuals beneath, one zoom for all; previews and cells on top.

import { axis, colour, CONFIG, look, onTheme, plotly } from "/assets/plotting.js";

const GAP = 0.028;
const POINTS = 4000;
const LETTER = 5.5; // pixels of a letter of a title

export default {
  template: `
    <div class="traces">
      <div class="traces-bar">
        <div class="chips" role="group" aria-label="Runs that are drawn">
          <button v-for="(run, number) in runs" :key="run.name" type="button" class="chip"
            :aria-pressed="chosen.includes(number)" :title="run.label" @click="toggle(number)">
            {{ run.name }}<span class="tag" v-if="run.split === 'check'">held out</span>
          </button>
        </div>
        <div class="zoom" role="group" aria-label="Zoom">
          <button type="button" class="icon" aria-label="Zoom in" title="Zoom in" @click="zoom(0.5)">+</button>
          <button type="button" class="icon" aria-label="Zoom out" title="Zoom out" @click="zoom(2)">&minus;</button>
          <button type="button" class="icon wide" @click="all()">All</button>
        </div>
      </div>
      <div class="legend">
        <span><i class="line measured"></i>measured</span>
        <span v-if="has.base"><i class="line base"></i>base model</span>
        <span v-if="has.model"><i class="line model"></i>present model</span>
        <span v-if="previewed"><i class="line preview"></i>{{ previewed }}, before any refit</span>
        <span v-if="picked"><i class="dot"></i>{{ picked }}
          <button type="button" class="link" @click="unpick()">clear</button></span>
        <span class="right">{{ note }}</span>
      </div>
      <div class="plot" ref="plot" role="img" :aria-label="label"></div>
    </div>`,
  props: { src: String, version: Number, runs: Array, view: Object },
  data: () => ({ chosen: [], has: {}, note: "", previewed: "", picked: "", label: "Traces of the runs" }),
  async mounted() {
    this.window = [null, null];
    this.previews = new Map();
    this.overlays = { preview: null, samples: null };
    this.choose();
    this.plotly = await plotly();
    this.offTheme = onTheme(() => this.draw());
    this.sized = new ResizeObserver(() => this.drawn && this.draw().then(() => this.plotly.Plots.resize(this.$refs.plot)));
    this.sized.observe(this.$refs.plot);
    this.listen();
    await this.load();
  },
  beforeUnmount() {
    this.offTheme?.();
    this.sized?.disconnect();
    for (const [name, own] of this.listeners || []) document.removeEventListener(name, own);
    if (this.plotly) this.plotly.purge(this.$refs.plot);
  },
  watch: {
    version() {
      this.previews.clear();
      this.overlays = { preview: null, samples: null };
      this.previewed = this.picked = "";
      if (this.chosen.some((number) => number >= this.runs.length) || !this.chosen.length) this.choose();
      this.load();
    },
  },
  methods: {
    /** Choose the first fit run and the first check run. */
    choose() {
      const first = (split) => this.runs.findIndex((run) => run.split === split);
      this.chosen = [first("fit"), first("check")].filter((number) => number >= 0);
      if (!this.chosen.length && this.runs.length) this.chosen = [0];
    },
    toggle(number) {
      const there = this.chosen.includes(number);
      if (there && this.chosen.length === 1) return;
      this.chosen = there ? this.chosen.filter((one) => one !== number) : [...this.chosen, number].slice(-4);
      this.chosen.sort((a, b) => a - b);
      this.load();
    },
    async get(what, query) {
      const answer = await fetch(`${this.src}/${what}?${new URLSearchParams(query)}`);
      return answer.ok ? answer.json() : null;
    },
    async load() {
      if (!this.plotly || !this.runs.length) return;
      const asked = (this.asked = (this.asked || 0) + 1);
      const points = Math.round(POINTS / Math.max(1, this.chosen.length > 2 ? 2 : 1));
      const query = { runs: this.chosen.join(","), points };
      if (this.window[0] !== null) Object.assign(query, { low: this.window[0], high: this.window[1] });
      const data = await this.get("traces", query);
      if (!data || asked !== this.asked) return;
      this.drawn = data;
      const lines = data.runs.flatMap((run) => Object.values(run.channels));
      this.has = { base: lines.some((one) => one.base), model: lines.some((one) => one.model) };
      this.note = data.exact ? "every reading is drawn" : "extremes kept; zoom in for every reading";
      await this.draw();
    },
    /** Return the rows of the picture: each channel, its residual, and what drives the runs. */
    rows() {
      const there = (name) => this.drawn.runs.some((run) => run.channels[name]);
      const found = [];
      for (const channel of this.view.channels.filter((one) => there(one.name))) {
        found.push({ channel, what: "overlay", weight: 2 });
        if (this.has.base) found.push({ channel, what: "residual", weight: 1.15 });
      }
      const drives = this.view.inputs.filter((one) => one.name !== "ambient_degC");
      if (drives.length) found.push({ channel: drives[0], what: "input", weight: 0.7 });
      return found;
    },
    async draw() {
      if (!this.drawn) return;
      const rows = this.rows();
      const columns = this.drawn.runs.length;
      const total = rows.reduce((sum, row) => sum + row.weight, 0);
      const data = [];
      this.revision = (this.revision || 0) + 1;
      const layout = {
        ...look(),
        datarevision: this.revision, // packed arrays are not compared: without it axes keep the range of others
        showlegend: false,
        hovermode: "x",
        dragmode: "zoom",
        margin: { l: 62, r: 10, t: 24, b: 40 },
        annotations: [],
        shapes: [],
      };
      let top = 1;
      this.places = {};
      rows.forEach((row, r) => {
        const height = (row.weight / total) * (1 - GAP * (rows.length - 1));
        const domain = [Math.max(0, top - height), top];
        top -= height + GAP;
        this.drawn.runs.forEach((run, c) => {
          const k = r * columns + c + 1;
          const [x, y] = [`x${k === 1 ? "" : k}`, `y${k === 1 ? "" : k}`];
          const width = (1 - 0.03 * (columns - 1)) / columns;
          const left = c * (width + 0.03);
          const last = r === rows.length - 1;
          layout[`xaxis${k === 1 ? "" : k}`] = {
            ...axis(), domain: [left, left + width], anchor: y, showticklabels: last, automargin: false,
            hoverformat: ".4~g",
            ...(k > 1 ? { matches: "x" } : {}),
            title: last ? { text: `time [${this.view.time.unit}]`, standoff: 4, font: { size: 12 } } : { text: "" },
            ...(this.window[0] === null ? { autorange: true } : { range: [...this.window], autorange: false }),
          };
          layout[`yaxis${k === 1 ? "" : k}`] = {
            ...axis(), domain, anchor: x, fixedrange: true, autorange: true, showticklabels: c === 0, automargin: false, nticks: 5,
            ...(c > 0 ? { matches: `y${r * columns + 1 === 1 ? "" : r * columns + 1}` } : {}),
            title: c === 0 ? { text: this.titleOf(row, height), standoff: 4, font: { size: 11 } } : { text: "" },
          };
          this.places[`${run.number} ${row.channel.name} ${row.what}`] = [x, y];
          data.push(...this.tracesOf(run, row, x, y));
          if (row.what === "residual") layout.shapes.push(...this.bandsOf(row, x, y));
          if (r === 0) layout.annotations.push(this.headOf(run, left));
        });
      });
      data.push(...this.overlayTraces());
      await this.plotly.react(this.$refs.plot, data, layout, CONFIG);
      if (!this.heard) {
        this.heard = true;
        this.$refs.plot.on("plotly_relayout", (event) => this.moved(event));
      }
    },
    titleOf(row, share) {
      const own = row.what === "residual" ? this.view.residuals[row.channel.name]?.unit : row.channel.unit;
      const unit = own ? ` [${own}]` : "";
      // Where a title would run into the next it stands in two lines; where they are too long, the unit says enough.
      const room = (share * (this.$refs.plot.clientHeight - 64)) / LETTER;
      const name = row.what === "residual" ? "residual" : row.channel.quantity;
      if (name.length + unit.length <= room) return `${name}${unit}`;
      return row.what === "overlay" && name.length <= room ? `${name}<br>${unit.trim()}` : unit.trim();
    },
    headOf(run, left) {
      const own = this.runs[run.number];
      const text = `<b>${escaped(own.name)}</b>  ${own.split === "check" ? "held out" : "fitted"}`;
      return {
        text, x: left, y: 1, xref: "paper", yref: "paper", xanchor: "left", yanchor: "bottom", showarrow: false,
        font: { size: 12 },
      };
    },
    tracesOf(run, row, x, y) {
      const line = (trace, name, hue, width, dash) => ({
        ...trace, type: "scatter", mode: "lines", name, xaxis: x, yaxis: y,
        line: { color: colour(hue), width, ...(dash ? { dash } : {}) },
        hovertemplate: `%{y:.4~g}<extra>${name}</extra>`,
      });
      if (row.what === "input") {
        const own = run.inputs[row.channel.name];
        return own ? [line(own, row.channel.quantity, "measured", 1.2)] : [];
      }
      const own = run.channels[row.channel.name];
      if (!own) return [];
      if (row.what === "overlay") {
        return [
          line(own.measured, "measured", "measured", 2.2),
          ...(own.base ? [line(own.base, "base model", "base", 1.4)] : []),
          ...(own.model ? [line(own.model, "present model", "model", 1.6)] : []),
        ];
      }
      return [
        ...(own.base_residual ? [line(own.base_residual, "base model", "base", 1.2)] : []),
        ...(own.model_residual ? [line(own.model_residual, "present model", "model", 1.4)] : []),
      ];
    },
    /** Return zero, the noise and the tolerance of a residual. */
    bandsOf(row, x, y) {
      const own = this.view.residuals[row.channel.name];
      if (!own) return [];
      const across = { type: "rect", xref: `${x} domain`, yref: y, x0: 0, x1: 1, layer: "below", line: { width: 0 } };
      const at = (value, dash) => ({
        type: "line", xref: `${x} domain`, yref: y, x0: 0, x1: 1, y0: value, y1: value,
        line: { color: colour("axis"), width: 1, dash },
      });
      return [
        { ...across, y0: -2 * own.noise, y1: 2 * own.noise, fillcolor: colour("band") },
        at(0, "solid"),
        ...(own.tolerance ? [at(own.tolerance, "dot"), at(-own.tolerance, "dot")] : []),
      ];
    },
    overlayTraces() {
      const found = [];
      for (const one of this.overlays.preview?.series || []) {
        const place = this.places[`${one.run} ${one.channel} residual`];
        if (!place) continue;
        found.push({
          x: one.x, y: one.y, type: "scatter", mode: "lines", name: "preview", xaxis: place[0], yaxis: place[1],
          line: { color: colour("preview"), width: 2.2 }, hoverinfo: "skip",
        });
      }
      for (const one of this.overlays.samples?.runs || []) {
        for (const [what, y] of [["overlay", one.measured], ["residual", one.residual]]) {
          const place = this.places[`${one.run} ${this.overlays.channel} ${what}`];
          if (!place) continue;
          found.push({
            x: one.x, y, type: "scatter", mode: "markers", name: "cell", xaxis: place[0], yaxis: place[1],
            marker: { color: colour("pick"), size: 6, line: { width: 0 } }, hoverinfo: "skip",
          });
        }
      }
      return found;
    },
    moved(event) {
      const [low, high] = [event["xaxis.range[0]"], event["xaxis.range[1]"]];
      if (low !== undefined && high !== undefined) this.window = [Number(low), Number(high)];
      else if (event["xaxis.autorange"]) this.window = [null, null];
      else return;
      clearTimeout(this.later);
      this.later = setTimeout(() => this.load(), 120);
    },
    zoom(factor) {
      const shown = this.$refs.plot.layout?.xaxis?.range;
      if (!shown) return;
      const [middle, half] = [(shown[0] + shown[1]) / 2, ((shown[1] - shown[0]) / 2) * factor];
      this.window = [Math.max(0, middle - half), middle + half];
      this.load();
    },
    all() {
      this.window = [null, null];
      this.load();
    },
    listen() {
      const own = (name, handler) => {
        document.addEventListener(name, handler);
        (this.listeners ||= []).push([name, handler]);
      };
      own("mouseover", (event) => this.point(event.target));
      own("focusin", (event) => this.point(event.target));
      own("workbench:cell", (event) => this.pick(event.detail));
    },
    /** Preview the candidate that is pointed at, and end the preview where none is. */
    async point(target) {
      const item = target.closest?.("[data-candidate]");
      const name = item?.dataset.candidate || "";
      if (name === (this.pointed || "")) return;
      this.pointed = name;
      if (name && !this.previews.has(name)) this.previews.set(name, await this.get("preview", { candidate: name }));
      if (this.pointed !== name) return;
      this.overlays.preview = name ? this.previews.get(name) : null;
      this.previewed = this.overlays.preview?.series?.length ? item.dataset.title : "";
      if (this.drawn) await this.draw();
    },
    async pick(cell) {
      const found = await this.get("samples", { channel: cell.channel, cell: cell.cell });
      if (!found) return;
      this.overlays.samples = found;
      this.overlays.channel = cell.channel;
      this.picked = cell.words;
      const with_samples = found.runs.map((one) => one.run);
      const missing = with_samples.filter((run) => !this.chosen.includes(run));
      if (missing.length === with_samples.length && with_samples.length) {
        this.chosen = with_samples.slice(0, 3);
        await this.load();
      } else await this.draw();
    },
    async unpick() {
      this.overlays.samples = null;
      this.picked = "";
      await this.draw();
    },
  },
};

function escaped(text) {
  return text.replace(/[&<>"]/g, (one) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" })[one]);
}
