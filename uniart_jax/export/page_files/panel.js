// The panel: a row a part, a slider a joint; states, play, display.

const SECONDS = 2.4; // from rest to open
const element = (id) => document.getElementById(id);

function angle(q) {
  const degrees = (q * 180) / Math.PI;
  return `${(Math.abs(degrees) < 0.05 ? 0 : degrees).toFixed(1)}°`.replace("-", "−");
}
function length(metres) {
  const mm = metres * 1000;
  return `${(Math.abs(mm) < 0.05 ? 0 : mm).toFixed(Math.abs(mm) < 100 ? 1 : 0)} mm`.replace("-", "−");
}
function reading(joint, q) {
  if (joint.type === "prismatic") return length(q);
  return joint.type === "screw" ? `${angle(q)} · ${length(q * joint.pitch)}` : angle(q);
}

function make(tag, className, text = "") {
  const made = document.createElement(tag);
  made.className = className;
  made.textContent = text;
  return made;
}

function makeRow(model, part, onInput, onHover) {
  const row = make("li", part.joint ? "part" : "part still");
  row.style.setProperty("--depth", Math.min([...lineage(model.parts, part.index)].length - 1, 6));
  const head = make("div", "head");
  const dot = make("span", "dot");
  dot.style.background = part.color;
  const title = make("span", "title", part.name);
  title.title = part.name;
  head.append(dot, title);
  row.append(head);
  row.addEventListener("pointerenter", () => onHover(part));
  row.addEventListener("pointerleave", () => onHover(null));
  if (!part.joint) return { row, refresh() {} };
  const { joint } = part;
  const [lo, hi] = joint.limits;
  title.append(make("small", "", joint.type));
  const value = make("output", "value");
  head.append(value);
  const slider = make("input", "");
  Object.assign(slider, { type: "range", min: lo, max: hi, step: "any", name: part.name });
  slider.setAttribute("aria-label", `${part.name}, ${joint.type}`);
  slider.addEventListener("input", () => onInput(part, Number(slider.value)));
  const unit = joint.type === "prismatic" ? length : angle;
  const travel = make("div", "travel");
  travel.append(slider, make("small", "", unit(lo)), make("small", "", unit(hi)));
  row.append(travel);
  return {
    row,
    refresh() {
      slider.value = part.q;
      slider.style.setProperty("--at", `${(100 * (part.q - lo)) / (hi - lo)}%`);
      value.textContent = reading(joint, part.q);
      slider.setAttribute("aria-valuetext", value.textContent);
    },
  };
}

async function main() {
  const asset = JSON.parse(element("asset").textContent);
  document.title = asset.name;
  element("name").textContent = asset.name;
  await addThree(element("three").textContent);
  const model = await loadModel(asset, element("glb").textContent);
  const rows = [];
  let stage = null;
  let moving = null; // what plays: time in ms -> state; null when all stands still

  const states = {
    rest: (part) => part.joint.rest,
    shown: () => 0,
    open: (part) => part.joint.open,
  };
  const refresh = () => {
    for (const row of rows) row.refresh();
    for (const button of document.querySelectorAll("[data-state]")) {
      const goal = states[button.dataset.state];
      const there = model.moving.every((part) => {
        const [lo, hi] = part.joint.limits;
        return Math.abs(part.q - goal(part)) <= 1e-6 * (hi - lo);
      });
      button.setAttribute("aria-current", String(there));
    }
    stage?.invalidate();
  };
  const halt = () => {
    moving = null;
    element("play").textContent = "Play";
    element("play").setAttribute("aria-pressed", "false");
  };
  const setJoint = (part, q) => {
    model.set(part, q);
    refresh();
  };
  const run = (step) => {
    const started = performance.now();
    moving = step;
    const tick = (now) => {
      if (moving !== step) return;
      const more = step(Math.max(0, now - started));
      refresh();
      if (more) requestAnimationFrame(tick);
      else halt();
    };
    requestAnimationFrame(tick);
  };
  const ease = (t) => t * t * (3 - 2 * t);
  const goTo = (goal) => {
    halt();
    const still = window.matchMedia("(prefers-reduced-motion: reduce)").matches;
    const from = new Map(model.moving.map((part) => [part, part.q]));
    run((ms) => {
      const t = still ? 1 : Math.min(ms / 450, 1);
      for (const [part, q] of from) model.set(part, q + (goal(part) - q) * ease(t));
      return t < 1;
    });
  };
  const play = () => {
    element("play").textContent = "Pause";
    element("play").setAttribute("aria-pressed", "true");
    const begin = model.moving[0];
    const span = begin.joint.open - begin.joint.rest;
    const done = Math.min(Math.max((begin.q - begin.joint.rest) / span, 0), 1);
    const phase = 0.5 - Math.sin(Math.asin(1 - 2 * done) / 3); // where the ease has come so far
    const from = new Map(model.moving.map((part) => [part, part.q]));
    run((ms) => {
      const t = (phase + ms / 1000 / SECONDS) % 2;
      const share = ease(t < 1 ? t : 2 - t);
      const joined = ease(Math.min(ms / 450, 1)); // joints that stood elsewhere catch up
      for (const [part, q] of from) {
        const { rest, open } = part.joint;
        model.set(part, q + (rest + (open - rest) * share - q) * joined);
      }
      return true;
    });
  };

  const onHover = (part) => {
    for (const [k, { row }] of rows.entries()) row.classList.toggle("lit", k === part?.index);
    stage?.light(part);
  };
  const onInput = (part, q) => {
    halt();
    setJoint(part, q);
  };
  rows.push(...model.parts.map((part) => makeRow(model, part, onInput, onHover)));
  // A tree reads depth first.
  const below = (k) => model.parts.flatMap((p) => (p.parent === k ? [p, ...below(p.index)] : []));
  for (const part of below(-1)) element("parts").append(rows[part.index].row);

  const onMove = Object.assign(setJoint, { grab: halt, hover: onHover });
  stage = makeStage(element("canvas"), element("tip"), model, asset, onMove);
  const sides = asset.size.map((side) => side.toFixed(2)).join(" × ");
  const count = (n, what) => `${n} ${what}${n === 1 ? "" : "s"}`;
  const { parts, moving: joints } = model;
  element("summary").textContent =
    `${count(parts.length, "part")} · ${count(joints.length, "joint")} · ${sides} m`;
  const step = stage.step;
  element("ruler").textContent = `grid ${step >= 1 ? `${step} m` : step >= 0.01 ? `${+(step * 100).toPrecision(1)} cm` : `${+(step * 1000).toPrecision(1)} mm`}`;
  element("fit").addEventListener("click", stage.reset);
  for (const what of ["axes", "collision", "colors", "wireframe"]) {
    const box = element(what);
    box.checked = false;
    box.addEventListener("change", () => stage.show(what, box.checked));
  }
  element("states").hidden = element("hint").hidden = joints.length === 0;
  const same = joints.every(({ joint }) => Math.abs(joint.rest) <= 1e-6 * (joint.limits[1] - joint.limits[0]));
  document.querySelector("[data-state=shown]").hidden = same; // one state is one button
  for (const button of document.querySelectorAll("[data-state]")) {
    button.addEventListener("click", () => goTo(states[button.dataset.state]));
  }
  element("play").addEventListener("click", () => (moving ? halt() : play()));
  refresh();

  // For tests and scripts: coordinates in radians or metres by part name, where the parts stand, what is shown.
  const named = (name) => {
    const part = joints.find((p) => p.name === name);
    if (!part) throw new Error(`no moving part is named "${name}"`);
    return part;
  };
  return {
    setJoint: (name, q) => onInput(named(name), q),
    joints: () => Object.fromEntries(joints.map((p) => [p.name, p.q])),
    matrices: model.matrices,
  };
}

window.viewer = null;
main().then(
  (viewer) => (window.viewer = viewer),
  (error) => {
    element("trouble").hidden = false;
    element("trouble").textContent = `The object cannot be drawn: ${error.message}`;
    console.error(error);
  },
);
