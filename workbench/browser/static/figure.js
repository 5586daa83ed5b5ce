// One figure that the server describes; its colours are names of the theme, and a click on it goes back to the server.

import { axis, CONFIG, look, onTheme, plotly, themed } from "/assets/plotting.js";

export default {
  template: `<div class="figure" role="img" :aria-label="label"></div>`,
  props: { figure: Object, label: String },
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
      this.draw();
    },
  },
  methods: {
    async draw() {
      if (!this.plotly || !this.figure) return;
      const given = themed(this.figure.layout || {});
      const layout = { margin: { l: 60, r: 16, t: 28, b: 44 }, ...look(), ...given };
      for (const name of new Set(["xaxis", "yaxis", ...Object.keys(given).filter((key) => /^[xy]axis/.test(key))])) {
        const own = given[name] || {};
        layout[name] = { ...axis(), ...own, title: { ...axis().title, ...(own.title || {}) } };
      }
      await this.plotly.react(this.$el, themed(this.figure.data), layout, CONFIG);
    },
  },
};
