// The description of the interface; what is tried out there goes with the session of the page and its token.
"use strict";
const page = document.documentElement;
const section = document.querySelector("#interface");
const { document: url, csrf } = section.dataset;

// every word that is searched stands in the address or in what is said of an operation
const opsFilter = (groups, phrase) => {
  const holds = (one) => {
    const text = `${one.get("method")} ${one.get("path")} ${["summary", "description"].map((name) => one.getIn(["operation", name]))}`;
    return phrase.toLowerCase().split(" ").every((word) => text.toLowerCase().includes(word));
  };
  return groups.map((group) => group.update("operations", (all) => all.filter(holds))).filter((group) => group.get("operations").size);
};
const nothing = () => null;

SwaggerUIBundle({
  url,
  domNode: section,
  docExpansion: "list",
  defaultModelsExpandDepth: -1,
  filter: true,
  plugins: [() => ({ fn: { opsFilter }, components: { InfoContainer: nothing, ServersContainer: nothing } })],
  requestInterceptor: (request) => {
    if (csrf) request.headers["X-CSRF-Token"] = csrf;
    return request;
  },
});

// what the library draws without a name, or out of reach of the keyboard
new MutationObserver(() => {
  for (const [selector, name, value] of [[".filter input", "aria-label", "Search"], [".filter input", "placeholder", "Search"], ["textarea", "aria-label", "Body"], ["pre", "tabindex", 0]]) {
    for (const one of section.querySelectorAll(`${selector}:not([${name}="${value}"])`)) one.setAttribute(name, value);
  }
}).observe(section, { childList: true, subtree: true });

const dark = matchMedia("(prefers-color-scheme: dark)");
const themed = () => page.classList.toggle("dark-mode", (page.dataset.theme ?? (dark.matches ? "dark" : "light")) === "dark");
themed();
dark.addEventListener("change", themed);
addEventListener("gearcase:theme", themed);
