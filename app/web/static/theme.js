// Runs before the first paint, so that a chosen theme never flashes.
"use strict";
{
  const chosen = localStorage.getItem("gearcase-theme");
  if (chosen === "dark" || chosen === "light") document.documentElement.dataset.theme = chosen;
}
