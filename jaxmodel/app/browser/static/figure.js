// One figure that the server describes; its colours are names of the theme, and a click on it goes back to the server.
// A map can be walked by keyboard too: arrows move a frame from cell to cell, Enter or Space is a click on its cell.

import { axis, CONFIG, look, onTheme, plotly, themed } from "/assets/plotting.js";

export default {
  template: `<div class="figure" role="img" :aria-label="said" :tabindex="map() ? 0 : null"
    @keydown="key" @blur="leave"></div>`,
  props: { figure: Object, label: String },
  data() {
    return { at: null };
  },
  computed: {
    said() {
      if (!this.at) return this.map() ? `${this.label}. Arrow keys move from cell to cell, Enter picks one.` : this.label;
      const { x, y, z } = this.map();
      const { row, column } = this.at;
      return `${this.label}: column ${column + 1} of ${x.length}, row ${row + 1} of ${y.length}, ${z[row][column] ?? "empty"}`;
    },
  },
  async mounted() {
    this.plotly = await plotly();
    this.offTheme = onTheme(() => this.draw());
    await this.draw();
    this.$el.on("plotly_click", (event) => {
      const at = event.points[0];
      this.$emit("pick", { x: at.x, y: at.y, row: at.pointIndex?.[0] ?? null, column: at.pointIndex?.[1] ?? null });
    });
  },
  beforeUnmount() {
    this.offTheme?.();
    if (this.plotly) this.plotly.purge(this.$el);
  },
  watch: {
    figure() {
      this.at = null;
      this.draw();
    },
  },
  methods: {
    map() {
      return this.figure?.data?.find((one) => one.type === "heatmap");
    },
    key(event) {
      const map = this.map();
      if (!map) return;
      const moves = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [1, 0], ArrowDown: [-1, 0] };
      const [up, right] = moves[event.key] ?? [0, 0];
      const picks = event.key === "Enter" || event.key === " ";
      if (!moves[event.key] && !picks) return;
      event.preventDefault();
      const { row, column } = this.at ?? { row: 0, column: 0 };
      const within = (place, count) => Math.min(Math.max(place, 0), count - 1);
      // The first key shows where the frame is.
      this.at = this.at ? { row: within(row + up, map.y.length), column: within(column + right, map.x.length) } : { row, column };
      if (picks) this.$emit("pick", { x: map.x[this.at.column], y: map.y[this.at.row], ...this.at });
      this.draw();
    },
    leave() {
      if (!this.at) return;
      this.at = null;
      this.draw();
    },
    frame() {
      const map = this.map();
      if (!map || !this.at) return [];
      const marker = { symbol: "square-open", size: 20, color: "var(--ink)", line: { width: 3 } };
      const there = { x: [map.x[this.at.column]], y: [map.y[this.at.row]] };
      return [{ type: "scatter", mode: "markers", hoverinfo: "skip", showlegend: false, marker, ...there }];
    },
    async draw() {
      if (!this.plotly || !this.figure) return;
      const given = themed(this.figure.layout || {});
      const layout = { margin: { l: 60, r: 16, t: 28, b: 44 }, ...look(), ...given };
      for (const name of new Set(["xaxis", "yaxis", ...Object.keys(given).filter((key) => /^[xy]axis/.test(key))])) {
        const own = given[name] || {};
        layout[name] = { ...axis(), ...own, title: { ...axis().title, ...(own.title || {}) } };
      }
      await this.plotly.react(this.$el, themed([...this.figure.data, ...this.frame()]), layout, CONFIG);
    },
  },
};
