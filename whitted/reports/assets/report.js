// Draws the plots in the page's colours, and draws them anew when these change.
(() => {
  const root = document.documentElement;
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const config = { responsive: true, displaylogo: false, modeBarButtonsToRemove: ["lasso2d", "select2d"] };

  const colours = () => {
    const style = getComputedStyle(document.body);
    const probe = document.createElement("i");
    document.body.append(probe);
    const resolve = (name) => {
      probe.style.color = `var(${name})`;
      return getComputedStyle(probe).color;
    };
    const found = { ink: style.color, grid: resolve("--hair"), line: resolve("--faint") };
    probe.remove();
    return found;
  };

  const layoutIn = ({ ink, grid, line }) => {
    const axis = { color: ink, gridcolor: grid, linecolor: line, zerolinecolor: grid };
    const spread = (name) => Object.fromEntries(Object.entries(axis).map(([key, value]) => [`${name}.${key}`, value]));
    return { "font.color": ink, "shapes[0].line.color": line, ...spread("xaxis"), ...spread("yaxis") };
  };

  const plots = [...document.querySelectorAll(".plot")];
  const draw = (plot) => {
    const { data, layout } = JSON.parse(document.getElementById(`${plot.id}-data`).textContent);
    return Plotly.newPlot(plot, data, layout, config).then(() => recolour(plot, colours()));
  };
  const recolour = (plot, palette) => {
    const update = layoutIn(palette);
    if (!plot.layout.shapes?.length) delete update["shapes[0].line.color"];
    return Plotly.relayout(plot, update);
  };
  const recolourAll = () => {
    const palette = colours();
    for (const plot of plots) if (plot.layout) recolour(plot, palette);
  };

  // A plot is drawn when it comes near the window, so that a long page opens fast.
  const watch = new IntersectionObserver(
    (entries) => {
      for (const { isIntersecting, target } of entries) {
        if (!isIntersecting) continue;
        watch.unobserve(target);
        draw(target);
      }
    },
    { rootMargin: "400px" },
  );
  for (const plot of plots) watch.observe(plot);
  addEventListener("beforeprint", () => plots.filter((plot) => !plot.layout).forEach(draw));

  document.getElementById("theme").addEventListener("click", () => {
    const isDark = root.dataset.theme ? root.dataset.theme === "dark" : dark.matches;
    root.dataset.theme = isDark ? "light" : "dark";
    recolourAll();
  });
  dark.addEventListener("change", recolourAll);
})();
