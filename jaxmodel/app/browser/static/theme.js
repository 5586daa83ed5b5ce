// Light or dark: what the system prefers, until the button says otherwise.

const stored = localStorage.getItem("theme");
const dark = window.matchMedia("(prefers-color-scheme: dark)");
document.documentElement.dataset.theme = stored || (dark.matches ? "dark" : "light");
dark.addEventListener("change", (event) => {
  if (!localStorage.getItem("theme")) document.documentElement.dataset.theme = event.matches ? "dark" : "light";
});
document.addEventListener("click", (event) => {
  if (!event.target.closest?.("#theme")) return;
  const next = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
  document.documentElement.dataset.theme = next;
  localStorage.setItem("theme", next);
});
