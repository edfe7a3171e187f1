// Error against effort of every setting: the figure drawn anew, as wide as the page, each place telling what it is.
(() => {
  const data = JSON.parse(document.getElementById("places").textContent);
  const still = document.querySelector("figure[data-figure=tradeoff]"), box = document.createElement("div");
  box.innerHTML = "<svg></svg>";
  const space = box.firstChild.namespaceURI;
  const make = (name, attributes, parent, text) => {
    const one = document.createElementNS(space, name);
    for (const [key, value] of Object.entries(attributes)) one.setAttribute(key, value);
    if (text != null) one.textContent = text;
    return parent?.appendChild(one) ?? one;
  };
  const ring = (count, turn, r, inner = r) => "M" + Array.from({ length: count }, (_, k) => {
    const angle = Math.PI * (2 * k / count + turn), size = k % 2 ? inner : r;
    return (size * Math.sin(angle)).toFixed(2) + " " + (-size * Math.cos(angle)).toFixed(2);
  }).join("L") + "Z";
  const plus = "M-2-5H2V-2H5V2H2V5H-2V2H-5V-2H-2Z";
  const shapes = { o: "M-4.5 0a4.5 4.5 0 1 0 9 0a4.5 4.5 0 1 0-9 0Z", s: ring(4, 0.25, 5.6), D: ring(4, 0, 5.6), "^": ring(3, 0, 6), v: ring(3, 1, 6), P: plus,
    X: plus, "*": ring(10, 0, 7, 3), "<": ring(3, 1.5, 6), ">": ring(3, 0.5, 6), h: ring(6, 0, 5.5), p: ring(5, 0, 5.5), x: "M-4-4L4 4M-4 4L4-4" };
  const turned = mark => mark === "X" ? " rotate(45)" : "";
  box.id = "scatter";
  still.prepend(box);
  const output = document.createElement("output"), button = document.createElement("button"), legend = document.createElement("ul");
  const svg = make("svg", { tabindex: 0, role: "group", "aria-label": "Error against effort of every setting; arrow keys go from one to the next" });
  box.replaceChildren(legend, svg, output, button);
  button.type = "button";

  const drawMark = (place, parent) => {
    const [, color, mark, full] = data.laws[place.law];
    const kind = place.fault ? "struck" : full ? "mark" : "mark hollow";
    return make("path", { class: kind, style: `--law:${color}`, d: shapes[place.fault ? "x" : mark], ...(place.fault ? {} : { transform: turned(mark).trim() }) }, parent);
  };
  const addEntry = (text, draw) => {
    const entry = legend.appendChild(document.createElement("li"));
    draw(make("svg", { viewBox: "-7 -7 14 14", "aria-hidden": true }, entry));
    entry.append(text);
  };
  data.laws.forEach(([law], k) => { if (data.places.some(one => one.law === k && !one.fault)) addEntry(law, at => drawMark({ law: k }, at)); });
  addEntry("baseline, " + data.baseline, at => make("path", { class: "base", d: shapes["*"] }, at));
  if (data.places.some(one => one.fault)) addEntry("left out", at => make("path", { class: "struck", d: shapes.x }, at));

  let whole = false, drawn = [], chosen = -1;
  const digits = value => Number(value.toPrecision(3)).toString();
  const describe = place => {
    const [effort, error] = place.at.map(digits), weighed = place.weighed == null ? "" : ` · weighed ${digits(place.weighed)} ×`;
    return `${place.number ? place.number + ". " : ""}${place.name}: contour error ${error} × the baseline’s · torque ${effort} ×${weighed}${place.fault ? " · left out: " + place.fault : ""}`;
  };
  const choose = k => {
    drawn[chosen]?.mark.classList.remove("near");
    chosen = k;
    drawn[k]?.mark.classList.add("near");
    output.textContent = k < 0 ? "Point at a setting to see what it is." : describe(drawn[k].place);
  };
  const draw = () => {
    const width = Math.max(box.clientWidth, 240), height = Math.round(Math.min(Math.max(0.62 * width, 280), 420));
    const view = data.views[whole ? "all" : "held"], [left, top, right, bottom] = [48, 8, width - 30, height - 40];
    const scale = ([low, high], from, to) => value => from + (to - from) * Math.log(value / low) / Math.log(high / low);
    const x = scale(view.x, left, right), y = scale(view.y, bottom, top), clip = (value, low, high) => Math.min(Math.max(value, low), high);
    svg.replaceChildren();
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    let last = -Infinity;
    for (const tick of view.ticks[0]) {
      make("line", { x1: x(tick), x2: x(tick), y1: top, y2: bottom }, svg);
      if (x(tick) - last > 44) make("text", { x: last = x(tick), y: bottom + 16, "text-anchor": "middle" }, svg, tick);
    }
    last = Infinity;
    for (const tick of view.ticks[1]) {
      make("line", { x1: left, x2: right, y1: y(tick), y2: y(tick) }, svg);
      if (last - y(tick) > 16) make("text", { x: left - 6, y: (last = y(tick)) + 4, "text-anchor": "end" }, svg, tick);
    }
    make("line", { class: "one", x1: x(1), x2: x(1), y1: top, y2: bottom }, svg);
    make("line", { class: "one", x1: left, x2: right, y1: y(1), y2: y(1) }, svg);
    make("text", { x: (left + right) / 2, y: height - 6, "text-anchor": "middle" }, svg, data.labels[0]);
    make("text", { transform: `translate(12 ${(top + bottom) / 2}) rotate(-90)`, "text-anchor": "middle" }, svg, data.labels[1]);
    drawn = [...data.places].sort((a, b) => !!b.fault - !!a.fault || b.number - a.number).map(place => {
      const at = [clip(x(place.at[0]), left, right), clip(y(place.at[1]), top, bottom)], mark = drawMark(place, svg);
      mark.setAttribute("transform", `translate(${at.map(one => one.toFixed(1))})${place.fault ? "" : turned(data.laws[place.law][2])}`);
      return { place, at, mark };
    });
    make("path", { class: "base", d: shapes["*"], transform: `translate(${x(1)} ${y(1)}) scale(1.3)` }, svg);
    let free = Infinity; // numbers from the lowest up, each clear of the one below
    for (const { place, at } of drawn.filter(one => one.place.number).sort((a, b) => b.at[1] - a.at[1])) {
      free = Math.min(at[1], free - 15);
      make("line", { class: "lead", x1: at[0] + 5, y1: at[1], x2: at[0] + 17, y2: free }, svg);
      make("text", { class: "number", x: at[0] + 19, y: free + 4 }, svg, place.number);
    }
    const beyond = drawn.filter(({ place: { at } }) => at[0] < view.x[0] || at[0] > view.x[1] || at[1] < view.y[0] || at[1] > view.y[1]).length;
    const some = data.places.some(one => one.fault);
    button.hidden = !some;
    button.textContent = whole ? "Fit to the settings that hold" : beyond ? `Show all: ${beyond} beyond the edge` : "Show all";
    choose(-1);
  };
  const find = event => {
    const { left, top, width } = svg.getBoundingClientRect(), share = svg.viewBox.baseVal.width / width;
    const at = [(event.clientX - left) * share, (event.clientY - top) * share];
    const far = drawn.map(one => Math.hypot(one.at[0] - at[0], one.at[1] - at[1]) + (one.place.fault ? 2 : 0)), least = Math.min(...far);
    return least < 30 ? far.indexOf(least) : -1;
  };
  for (const kind of ["pointermove", "pointerdown"]) svg.addEventListener(kind, event => choose(find(event)));
  svg.addEventListener("keydown", event => {
    const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
    if (!step || !drawn.length) return;
    event.preventDefault();
    const order = drawn.map((_, k) => k).sort((a, b) => drawn[a].place.at[1] - drawn[b].place.at[1]);
    choose(order.at((order.indexOf(chosen) + (chosen < 0 && step < 0 ? 0 : step) + order.length) % order.length));
  });
  button.addEventListener("click", () => { whole = !whole; draw(); });
  document.documentElement.classList.add("drawn");
  let before = 0;
  const fit = () => { if (box.clientWidth !== before) draw(before = box.clientWidth); };
  fit(); // a page that is printed or pictured may never come to a frame
  new ResizeObserver(() => requestAnimationFrame(fit)).observe(box);
})();
