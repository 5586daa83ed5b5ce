// What both charts share: plotly from this server, once, and the colours of the theme of the moment.

let loading = null;

/** Load plotly from this server; the promise is the same for every chart. */
export function plotly() {
  if (!loading) {
    loading = new Promise((done, failed) => {
      const script = document.createElement("script");
      script.src = "/plotly/plotly.min.js";
      script.onload = () => done(window.Plotly);
      script.onerror = () => failed(new Error("plotly could not be loaded from this server"));
      document.head.append(script);
    });
  }
  return loading;
}

/** Return a colour of the theme by its name in workbench.css. */
export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

/** Replace every "var(--name)" in a figure by the colour of the theme. */
export function themed(value) {
  if (typeof value === "string") {
    return value.replace(/var\(--([\w-]+)\)/g, (_, name) => colour(name));
  }
  if (Array.isArray(value)) return value.map(themed);
  if (value && typeof value === "object") {
    return Object.fromEntries(Object.entries(value).map(([key, one]) => [key, themed(one)]));
  }
  return value;
}

/** Call a function whenever the theme changes; returns what ends that. */
export function onTheme(changed) {
  const observer = new MutationObserver(changed);
  observer.observe(document.documentElement, { attributes: true, attributeFilter: ["data-theme"] });
  return () => observer.disconnect();
}

/** The look of every chart. */
export function look() {
  return {
    paper_bgcolor: "rgba(0,0,0,0)",
    plot_bgcolor: "rgba(0,0,0,0)",
    font: { family: getComputedStyle(document.body).fontFamily, size: 12, color: colour("ink") },
    hoverlabel: {
      bgcolor: colour("raised"),
      bordercolor: colour("line"),
      font: { color: colour("ink"), size: 12 },
    },
  };
}

/** The look of every axis. */
export function axis() {
  return {
    gridcolor: colour("grid"),
    linecolor: colour("axis"),
    zerolinecolor: colour("axis"),
    tickcolor: colour("axis"),
    ticks: "outside",
    ticklen: 4,
    showline: true,
    zeroline: false,
    automargin: true,
    title: { standoff: 6, font: { size: 12 } },
    tickfont: { color: colour("soft"), size: 11 },
  };
}

export const CONFIG = { displayModeBar: false, displaylogo: false, responsive: true, showTips: false };
