// The figures over time, drawn by uPlot from the page's data: one cursor, one zoom and one legend for all of them.
(() => {
  const page = JSON.parse(document.getElementById("data").textContent);
  const root = document.documentElement, style = name => getComputedStyle(root).getPropertyValue(name).trim();
  const read = text => {
    const bytes = Uint8Array.from(atob(text), one => one.charCodeAt(0));
    return new Float32Array(bytes.buffer); // little-endian, as every machine with a browser is
  };
  const times = page.series.times.map(read), end = page.duration;
  const group = (value, digits) => value.toLocaleString("en-US", { maximumFractionDigits: Math.min(digits, 12) });
  const writeTicks = (u, ticks, axis, room, step) => { // as many decimals as their steps have
    let digits = 0;
    while (digits < 12 && Math.abs(step * 10 ** digits - Math.round(step * 10 ** digits)) > 1e-6) digits++;
    return ticks.map(tick => tick == null ? "" : group(tick, digits));
  };
  const timeDigits = Math.min(Math.max(4, 4 - Math.floor(Math.log10(end))), 9), writeTime = t => t.toFixed(timeDigits) + " s";
  // The room for the numbers beside the figures: one for all, so that their times stand below each other.
  const widest = Object.values(page.series.figures).flat().flatMap(panel => [...panel.levels.map(([level]) => level), ...panel.series.flatMap(one => {
    const y = read(one.y);
    return [y.reduce((a, b) => Math.min(a, b), 0), y.reduce((a, b) => Math.max(a, b), 0)];
  })]).reduce((most, value) => Math.max(most, group(1.05 * value, Math.abs(value) < 10 && value ? 1 - Math.floor(Math.log10(Math.abs(value))) : 0).length), 0);
  const gutter = Math.max(62, Math.ceil(7.5 * widest) + 18);
  root.style.setProperty("--gutter", gutter + "px");
  const plots = [], dashes = [[], [8, 4], [8, 3, 2, 3], [2, 3]], levelDash = [6, 4];
  let shown = [0, end], now = 0, busy = false, hidden = new Set();

  // Series with instants of their own share an axis: at those of the others they have no value, and lines pass over.
  const align = panel => {
    const used = [...new Set(panel.series.map(one => one.t))];
    if (used.length === 1) return [times[used[0]], ...panel.series.map(one => read(one.y))];
    const t = Float32Array.from(new Set(used.flatMap(k => Array.from(times[k])))).sort();
    return [t, ...panel.series.map(one => {
      const own = times[one.t], y = read(one.y);
      let k = 0;
      return Array.from(t, at => {
        while (k < own.length - 1 && own[k + 1] <= at) k++;
        return own[k] === at ? y[k] : null;
      });
    })];
  };
  // The place of the last instant up to a time, and of the nearest.
  const findLast = (t, at) => {
    let [low, high] = [0, t.length];
    while (low < high) t[(low + high) >> 1] <= at ? low = ((low + high) >> 1) + 1 : high = (low + high) >> 1;
    return low - 1;
  };
  const findNearest = (t, at) => {
    const k = Math.max(findLast(t, at), 0);
    return k + 1 < t.length && t[k + 1] - at < at - t[k] ? k + 1 : k;
  };
  const makeWriter = panel => {
    const ys = panel.series.map(one => read(one.y));
    let most = 0;
    for (const y of ys) for (const value of y) most = Math.max(most, Math.abs(value));
    const write = value => {
      const size = Math.abs(value);
      if (size <= 1e-7 * most) return (0).toFixed(4); // as fine as these numbers are
      return size >= 1e5 || size < 1e-3 ? value.toExponential(3) : value.toFixed(size < 10 ? 4 : size < 1000 ? 3 : 1);
    };
    return (k, at) => {
      const { t, thinned, step } = panel.series[k], own = times[t], y = ys[k], last = own.length - 1;
      if (at == null || at < own[0] || at > own[last]) return "–";
      const near = step ? findLast(own, at) : findNearest(own, at);
      if (!thinned || near === 0 || near === last) return write(y[near]);
      const first = 2 * Math.floor((findLast(own, at) - 1) / 2) + 1; // two for each stretch
      const [low, high] = first < 1 ? [y[0], y[0]] : [y[first], y[first + 1]].sort((a, b) => a - b);
      return write(low) === write(high) ? write(low) : write(low) + " … " + write(high);
    };
  };
  const pick = color => color === "#000000" ? style("--ink") : color;
  const everywhere = action => {
    if (busy) return;
    busy = true;
    plots.forEach(action);
    busy = false;
  };

  const drawLines = panel => u => {
    const { ctx, bbox } = u, [low, high] = [u.scales.y.min, u.scales.y.max], line = (x0, y0, x1, y1) => {
      ctx.beginPath(); ctx.moveTo(x0, y0); ctx.lineTo(x1, y1); ctx.stroke();
    };
    ctx.save();
    ctx.lineWidth = devicePixelRatio;
    const ends = page.segments.filter(([at]) => at > u.scales.x.min && at < u.scales.x.max);
    ctx.strokeStyle = style("--line");
    if (ends.length <= 60) for (const [at] of ends) {
      const x = Math.round(u.valToPos(at, "x", true));
      line(x, bbox.top, x, bbox.top + bbox.height);
    }
    ctx.setLineDash(levelDash.map(part => part * devicePixelRatio));
    for (const [level, color] of panel.levels) if (level >= low && level <= high) {
      ctx.strokeStyle = pick(color);
      const y = u.valToPos(level, "y", true);
      line(bbox.left, y, bbox.left + bbox.width, y);
    }
    ctx.restore();
  };
  const makePlot = (panel, box) => {
    const axis = { values: writeTicks, stroke: () => style("--soft"), grid: { stroke: () => style("--line"), width: 1 }, ticks: { stroke: () => style("--line"), width: 1 } };
    const range = (u, low, high) => {
      const whole = shown[0] <= 0 && shown[1] >= end, held = whole ? panel.levels.map(([level]) => level) : [];
      const [from, to] = [Math.min(low ?? 0, ...held), Math.max(high ?? 1, ...held)], room = 0.04 * (to - from || Math.abs(to) || 1);
      return [from - room, to + room];
    };
    const steps = panel.series.some(one => one.step), write = makeWriter(panel);
    const u = new uPlot({
      width: box.clientWidth, height: 210,
      title: panel.label,
      scales: { x: { time: false, range: (_, low, high) => [Math.max(low, 0), high] }, y: { range } },
      axes: [{ ...axis, size: 34 }, { ...axis, size: gutter }],
      cursor: { y: false, sync: { key: "time", scales: ["x", null] }, drag: { x: true, y: false, dist: 4 }, bind: { mouseleave: () => null },
        points: { size: 6 }, focus: { prox: -1 },
        // what holds from an instant on holds until the next
        dataIdx: (me, _, near, at) => steps && near > 0 && me.data[0][near] > at ? near - 1 : near },
      series: [{ label: "time", value: (_, t) => t == null ? "–" : writeTime(t) }, ...panel.series.map(one => ({
        label: one.name, stroke: () => pick(one.color), width: 1.3, dash: dashes[one.dash], spanGaps: true,
        points: { show: false }, value: (me, value, k, at) => write(k - 1, at == null ? null : me.data[0][at]), ...(one.step ? { paths: uPlot.paths.stepped({ align: 1 }) } : {}) }))],
      hooks: {
        draw: [drawLines(panel)],
        setCursor: [me => { if (!busy && me.cursor.event && me.cursor.left >= 0) goTo(me.posToVal(me.cursor.left, "x"), me); }],
        setScale: [(me, which) => { if (which === "x" && !busy && me.scales.x.min != null) zoom(me.scales.x.min, me.scales.x.max); }],
        setSeries: [(me, k, options) => { if (k != null && options.show != null && !busy) show(me.series[k].label, options.show); }],
      },
    }, align(panel), box);
    return u;
  };

  // One time for all: the cursor of every figure, the scrubber, and the machine in space.
  const strip = document.getElementById("strip"), slider = strip.querySelector("input"), canvas = strip.querySelector("canvas");
  const said = strip.querySelector("output"), mark = strip.querySelector("i");
  const segmentAt = t => page.segments.findLast(([at]) => at <= t)?.[1] ?? "";
  const ownerAt = t => page.band.runs.findLast(([from]) => from <= t)?.[1] ?? -1;
  const goTo = (t, source, quiet) => {
    now = Math.min(Math.max(t, 0), end);
    busy = true;
    for (const u of plots) if (u !== source) u.setCursor({ left: u.valToPos(now, "x"), top: 10 }, true, false);
    busy = false;
    placeMark();
    if (!quiet) sendTime();
  };
  const placeMark = () => {
    const share = (now - shown[0]) / (shown[1] - shown[0]), owner = ownerAt(now);
    mark.hidden = share < 0 || share > 1;
    mark.style.left = 100 * share + "%";
    const [by, none] = page.band.words ?? ["held by ", "no limit is active"];
    const limit = owner < 0 ? none : by + page.band.limits[owner].name;
    said.textContent = [writeTime(now), segmentAt(now), limit].filter(Boolean).join(" · ");
    slider.value = Math.round(slider.max * (now - shown[0]) / (shown[1] - shown[0]));
    slider.setAttribute("aria-valuetext", said.textContent);
  };
  const zoom = (from, to) => {
    const [low, high] = from < to ? [Math.max(from, 0), Math.min(to, end)] : [0, end];
    shown = high > low ? [low < end * 1e-6 ? 0 : low, high > end * (1 - 1e-6) ? end : high] : [0, end]; // times are rounded
    everywhere(u => u.setScale("x", { min: shown[0], max: u.data[0].at(-1) > end && shown[1] === end ? u.data[0].at(-1) : shown[1] }));
    strip.querySelector("button").hidden = shown[0] <= 0 && shown[1] >= end;
    drawStrip();
    goTo(now, null, true);
  };
  const show = (name, visible) => {
    hidden[visible ? "delete" : "add"](name);
    everywhere(u => u.series.forEach((one, k) => { if (k && one.label === name && one.show !== visible) u.setSeries(k, { show: visible }); }));
  };
  const drawStrip = () => {
    const ratio = devicePixelRatio, width = canvas.clientWidth, height = canvas.clientHeight, ctx = canvas.getContext("2d");
    [canvas.width, canvas.height] = [width * ratio, height * ratio];
    ctx.scale(ratio, ratio);
    const place = t => width * (t - shown[0]) / (shown[1] - shown[0]), bar = 18;
    page.band.runs.forEach(([from, owner], k) => {
      const to = page.band.runs[k + 1]?.[0] ?? end;
      if (to < shown[0] || from > shown[1]) return;
      ctx.fillStyle = owner < 0 ? style("--line") : page.band.limits[owner].color;
      ctx.fillRect(place(from), 0, Math.max(place(to) - place(from), 0.5), bar);
    });
    ctx.font = "12px system-ui, sans-serif";
    ctx.textBaseline = "middle";
    let free = -1;
    const seen = page.segments.filter(([from], k) => from <= shown[1] && (page.segments[k + 1]?.[0] ?? end) >= shown[0]).length;
    const crowded = seen > width / 14; // then only some are marked, each with its number
    page.segments.forEach(([from, name], k) => {
      const left = Math.max(place(from), 0), right = Math.min(place(page.segments[k + 1]?.[0] ?? end), width);
      if (right < 0 || left > width || left < free) return;
      ctx.fillStyle = style("--soft");
      ctx.fillRect(left, bar, 1, height - bar);
      const short = name.match(/\d+/)?.[0] ?? name, room = crowded ? width - left : right - left;
      const text = (crowded ? [short] : [name.split(",")[0], short]).find(one => ctx.measureText(one).width + 8 < room);
      if (text) ctx.fillText(text, left + 4, bar + (height - bar) / 2);
      free = left + (crowded ? Math.max(60, ctx.measureText(short).width + 24) : 2);
    });
  };

  try {
    for (const still of document.querySelectorAll("figure[data-figure]")) {
      const panels = page.series.figures[still.dataset.figure];
      if (!panels) continue;
      const living = document.createElement("div");
      living.className = "living";
      still.before(living);
      root.classList.add("lives"); // before the figures, which take the width that they then have
      for (const panel of panels) {
        const box = living.appendChild(document.createElement("div"));
        plots.push(makePlot(panel, box));
      }
      still.classList.add("still");
      const text = still.querySelector("figcaption").cloneNode(true);
      if (text.dataset.living) text.textContent = text.dataset.living;
      const thinned = panels.some(panel => panel.series.some(one => one.thinned));
      if (thinned) text.append(" Each line is thinned to its extremes: of every stretch of time the least and the greatest are shown, here and at the cursor.");
      living.append(text);
    }
  } catch (error) {
    root.classList.remove("lives"); // the still figures say the same
    throw error;
  }
  strip.hidden = !plots.length;
  const legend = strip.querySelector("ul");
  const grey = page.band.runs.some(([, owner]) => owner < 0) ? [{ name: (page.band.words ?? ["", "no limit is active"])[1], color: "var(--line)" }] : [];
  for (const { name, color } of [...page.band.limits, ...grey]) {
    const entry = legend.appendChild(document.createElement("li"));
    entry.append(name);
    entry.style.setProperty("--chip", color);
  }
  slider.addEventListener("input", () => goTo(shown[0] + slider.valueAsNumber / slider.max * (shown[1] - shown[0])));
  strip.querySelector("button").addEventListener("click", () => zoom(0, end));
  const resize = () => {
    for (const u of plots) {
      const width = u.root.parentNode.clientWidth;
      u.setSize({ width, height: width < 500 ? 170 : 210 });
    }
    requestAnimationFrame(fit); // uPlot has its new size then
  };
  const fit = () => {
    root.style.setProperty("--strip", strip.offsetHeight + "px");
    if (plots.length) { // the scrubber is as wide as the figures are inside
      const inside = plots[0].over.getBoundingClientRect(), outside = plots[0].root.parentNode.getBoundingClientRect();
      canvas.parentNode.style.margin = `0 ${outside.right - inside.right}px 0 ${inside.left - outside.left}px`;
    }
    drawStrip();
    goTo(now, null, true);
  };
  new ResizeObserver(() => requestAnimationFrame(resize)).observe(document.querySelector(".living") ?? strip);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { plots.forEach(u => u.redraw(false, true)); drawStrip(); });

  const space = document.getElementById("space"), button = space?.querySelector("button");
  let frame = null, asked = 0, sent = -Infinity, led = false;
  const sendTime = () => {
    sent = performance.now();
    if (!frame || asked) return;
    asked = requestAnimationFrame(() => {
      asked = 0;
      frame.contentWindow.postMessage({ seek: now }, "*");
    });
  };
  button?.addEventListener("click", () => {
    frame?.remove();
    frame = frame ? null : document.createElement("iframe");
    space.classList.toggle("open", frame !== null);
    button.textContent = frame ? "Close the machine in 3-D" : "Show the machine in 3-D";
    if (!frame) return;
    led = false;
    frame.title = "The machine in 3-D";
    frame.srcdoc = JSON.parse(document.getElementById("machine").textContent);
    space.lastElementChild.append(frame);
  });
  addEventListener("message", event => {
    if (!frame || event.source !== frame.contentWindow || typeof event.data?.time !== "number") return;
    if (!led) { // it begins where the page is
      led = true;
      if (now > 0) sendTime();
    }
    if (performance.now() - sent > 500) goTo(event.data.time, null, true);
  });
  zoom(0, end);
})();
