// The page of `rcg live`: shows what the server says, and asks it for what hands choose. It keeps no state but what is drawn.
"use strict";
const $ = (id) => document.getElementById(id);
const token = location.hash.slice(1);
const COLOURS = { hole: "#e69f00", rim: "#56b4e9", wire: "#cc79a7", horizon: "#009e73", spot: "#f0e442" };
const SATURATED = 255;
let state = null, picture = null, trouble = null;

/** Text in an element, which is hidden without any. */
const say = (id, text) => { $(id).textContent = text ?? ""; };
const shown = (id, is) => { $(id).hidden = !is; };

const complain = (text) => {
  trouble = text;
  const all = [trouble, state?.problem].filter(Boolean).join(" · ");
  say("problem", all);
  shown("problem", all !== "");
};

/** Asks for something; what is refused is said. */
const ask = async (wish) => {
  try {
    const answer = await fetch("/do", { method: "POST", headers: { Authorization: `Bearer ${token}` }, body: JSON.stringify(wish) });
    complain(answer.ok ? null : (await answer.text()).trim());
  } catch {
    complain("the program does not answer: has it ended?");
  }
};

// --- what comes

let waiting = 500;
const connect = () => {
  if (!/^[0-9a-f]{32}$/.test(token)) {
    complain("expected the address that `rcg live` printed, with its token behind #, found one without");
    document.documentElement.dataset.ready = "no";
    return;
  }
  const socket = new WebSocket(`ws://${location.host}/live`);
  socket.binaryType = "arraybuffer";
  let refused = false;
  socket.onopen = () => socket.send(token);
  socket.onmessage = ({ data }) => {
    if (typeof data !== "string") {
      const sizes = new DataView(data);
      const [width, height, channels, step] = [0, 2, 4, 6].map((at) => sizes.getUint16(at, true));
      picture = { width, height, channels, step, values: new Uint8Array(data, 8) };
      later();
      return;
    }
    const told = JSON.parse(data);
    if (told === "token") {
      refused = true;
      complain("expected the token of the program that runs, found another: open the address that it printed");
      return;
    }
    waiting = 500;
    if (state === null) complain(null);
    state = told;
    later();
  };
  socket.onclose = () => {
    if (refused) return;
    complain("the connection has ended: is the program still running? It is tried again");
    state = null;
    setTimeout(connect, waiting);
    waiting = Math.min(2 * waiting, 10000);
  };
  current = socket;
};
let current = null, due = false;
/** Draws once for all that came, and asks for more. */
const later = () => {
  if (due) return;
  due = true;
  // A page in the background has no frames of animation.
  const act = () => {
    due = false;
    draw();
    if (current?.readyState === WebSocket.OPEN) current.send("more");
  };
  if (document.hidden) setTimeout(act, 500); else requestAnimationFrame(act);
};

// --- what is drawn

const drawImage = () => {
  if (!picture?.width) return;
  const { width, height, channels, step, values } = picture;
  const canvas = $("image");
  // Lines are drawn finer than pixels.
  const scale = Math.max(1, Math.round(768 / width));
  if (canvas.width !== width * scale || canvas.height !== height * scale) Object.assign(canvas, { width: width * scale, height: height * scale });
  const pen = canvas.getContext("2d");
  const image = new ImageData(width, height);
  for (let at = 0, from = 0; at < image.data.length; at += 4, from += channels) {
    let is = false;
    for (let channel = 0; channel < channels; channel++) is ||= values[from + channel] === SATURATED;
    for (let channel = 0; channel < 3; channel++) image.data[at + channel] = is ? [255, 0, 48][channel] : values[from + (channels === 3 ? channel : 0)];
    image.data[at + 3] = 255;
  }
  const copy = new OffscreenCanvas(width, height);
  copy.getContext("2d").putImageData(image, 0, 0);
  pen.imageSmoothingEnabled = false;
  pen.drawImage(copy, 0, 0, canvas.width, canvas.height);
  if (!$("outlines").checked || !state) return;
  pen.lineWidth = Math.max(1.5, scale / 2);
  for (const { name, pieces_px } of state.outlines) {
    pen.strokeStyle = COLOURS[name];
    pen.beginPath();
    for (const [a, b] of pieces_px) {
      pen.moveTo(a[0] / step * scale, a[1] / step * scale);
      pen.lineTo(b[0] / step * scale, b[1] / step * scale);
    }
    pen.stroke();
  }
};

const ink = (name) => getComputedStyle(document.documentElement).getPropertyValue(name);
/** Bars of what is in `counts`, the height their logarithm. */
const drawHistogram = (id, counts) => {
  const canvas = $(id), pen = canvas.getContext("2d");
  pen.clearRect(0, 0, canvas.width, canvas.height);
  const most = Math.log1p(Math.max(1, ...counts)), width = canvas.width / counts.length;
  counts.forEach((count, at) => {
    const height = Math.log1p(count) / most * (canvas.height - 4);
    pen.fillStyle = at === counts.length - 1 ? ink("--bad") : ink("--accent");
    pen.fillRect(at * width, canvas.height - height, Math.max(1, width - 1), height);
  });
};
const drawFocus = (history) => {
  const canvas = $("focus"), pen = canvas.getContext("2d");
  pen.clearRect(0, 0, canvas.width, canvas.height);
  if (history.length === 0) return;
  const most = Math.max(...history), least = Math.min(...history), range = Math.max(most - least, 1e-3 * most, 1e-9);
  pen.strokeStyle = ink("--accent");
  pen.lineWidth = 2;
  pen.beginPath();
  history.forEach((value, at) => pen.lineTo(at / 119 * canvas.width, canvas.height - 6 - (value - least) / range * (canvas.height - 12)));
  pen.stroke();
};

/** The children of a list, made anew only where they are others: a button keeps the focus. */
const list = (id, items, make) => {
  const text = JSON.stringify(items), parent = $(id);
  if (parent.dataset.of === text) return;
  parent.dataset.of = text;
  parent.replaceChildren(...items.map(make));
};
const line = (text, kind) => Object.assign(document.createElement("li"), { textContent: text, className: kind ?? "" });
/** A length with its sign, and no negative nothing. */
const signed = (px) => (Math.round(10 * px) / 10 + 0).toFixed(1);
const time = (s) => s < 90 ? `${s.toFixed(0)} s` : s < 5400 ? `${(s / 60).toFixed(0)} min` : `${(s / 3600).toFixed(1)} h`;
/** Puts a value into a field that nobody writes in. */
const fill = (id, value) => { if (document.activeElement !== $(id) && value != null) $(id).value = value; };

const drawAdvice = () => {
  const { advice, task, rounds } = state;
  say("rounds", rounds ? `(round ${rounds})` : "");
  list("moves", advice?.moves ?? [], (one) => {
    const item = line(one.words + " ", one.is_clear ? "clear" : "");
    if (one.is_clear && state.is_virtual) {
      const button = Object.assign(document.createElement("button"), { textContent: "do it" });
      button.onclick = () => { button.disabled = true; ask({ move: { part: one.part, motion: one.motion, by: one.by } }); };
      item.append(button);
    }
    return item;
  });
  list("untold", advice?.undetermined ?? [], (one) => line(`not told: ${one.what} (± ${one.standard_uncertainty.toFixed(1)} ${one.unit})`));
  say("verdict", advice && `Directions are off by ${advice.directions_deg.toFixed(2)}° (RMS), ${advice.directions_after_deg.toFixed(2)}° behind these moves; centres by ${advice.lateral_mm.toFixed(2)} ± ${advice.lateral_uncertainty_mm.toFixed(2)} mm. ${advice.is_aligned ? "Aligned: calibrate now." : "Make the moves, then find them again."}`);
  shown("follow", state.is_virtual && advice != null);
  shown("calibrate", state.can_calibrate);
  shown("task", task != null);
  for (const id of ["advise", "follow", "calibrate"]) $(id).disabled = task != null;
  if (!task) return;
  Object.assign($("done"), { max: Math.max(1, task.of), value: task.done });
  say("doing", task.of ? `${task.what}, ${task.done} of ${task.of}` : task.what);
  shown("asks", task.asks != null);
  if (task.asks) {
    say("target", `${task.asks.complaint ? task.asks.complaint + ". " : ""}Put into the holder: ${task.asks.target}`);
    shown("keep", task.asks.can_keep);
  }
};

const drawMeasurement = () => {
  const far = state.measurement;
  shown("measurement", far != null);
  if (!far) return;
  Object.assign($("captured"), { max: Math.max(1, far.of), value: far.done });
  const rate = far.rate_hz ? `, ${far.rate_hz.toFixed(1)} exposures a second, ${time(far.left_s)} left` : "";
  say("far", `${far.dir}: ${far.state}, ${far.done} of ${far.of} exposures${rate}; ${far.missed} triggers missed, ${far.dropped} frames dropped, ${far.repeated} exposures repeated${far.problem ? `; ${far.problem}` : ""}`);
  if (far.look) drawHistogram("newest", far.look.histogram);
  shown("report", far.has_report);
};

const draw = () => {
  drawImage();
  if (!state) return;
  complain(trouble);
  say("rig", `${state.rig}${state.is_virtual ? ", virtual" : ""}`);
  const { look, strobe } = state;
  const share = look.values ? 100 * look.saturated / look.values : 0;
  say("figures", `${state.size_px.join("×")} pixels, picture ${state.number}, ${state.rate_hz.toFixed(1)} a second; ${state.missed} triggers missed, ${state.dropped} frames dropped`);
  say("histogram-says", `Histogram, 0 to ${look.full_dn} digital numbers (counts logarithmic): median ${look.median_dn}, one in a thousand above ${look.bright_dn}, ${look.saturated} saturated (${share.toFixed(2)} %)`);
  say("focus-says", `Focus figure ${look.sharpness.toFixed(2)} of the last ${state.sharpness.length} pictures`);
  drawHistogram("histogram", look.histogram.length ? look.histogram : [0]);
  drawFocus(state.sharpness);
  list("edges", state.outlines.map(({ name, seen }) => ({ name, seen })), ({ name, seen }) => line(seen
    ? `${name}: seen ${seen.distance_px.toFixed(1)} px from where it is expected (${signed(seen.shift_px[0])} px right, ${signed(seen.shift_px[1])} px down)`
    : `${name}: not seen`));
  for (const button of document.querySelectorAll("[data-show]")) button.setAttribute("aria-pressed", button.dataset.show === state.shown);
  for (const button of document.querySelectorAll("[data-hold]")) button.setAttribute("aria-pressed", button.dataset.hold === state.held);
  say("held", `in the holder: ${state.held}; shown: ${state.shown}`);
  fill("exposure", Number(state.exposure_ms.toPrecision(5)));
  $("auto").setAttribute("aria-pressed", state.is_automatic);
  fill("gain", state.gain);
  say("gain-unit", state.is_virtual ? "dB (0 to 24)" : "(the camera's unit)");
  say("strobe", strobe ? `STROBE ${strobe.delay_us.toFixed(1)} µs after the trigger, ${strobe.width_us.toFixed(1)} µs long` : "no STROBE yet");
  say("run", state.running ? "pause" : "go on");
  shown("screws", state.is_virtual);
  say("plug", state.is_plugged ? "unplug the camera" : "plug the camera in");
  list("checklist", state.checklist, ({ what, done, hint }) => {
    const item = line(what, done ? "done" : "");
    item.append(Object.assign(document.createElement("span"), { className: "hint", textContent: hint }));
    return item;
  });
  drawAdvice();
  drawMeasurement();
  document.documentElement.dataset.ready = picture?.width || state.problem ? "yes" : "soon";
};

// --- hands

const number = (id) => Number($(id).value);
const submit = (id, act) => $(id).addEventListener("submit", (event) => { event.preventDefault(); act(); });
for (const button of document.querySelectorAll("[data-show]")) button.onclick = () => ask({ show: button.dataset.show });
for (const button of document.querySelectorAll("[data-hold]")) button.onclick = () => ask({ hold: button.dataset.hold });
for (const button of document.querySelectorAll("[data-answer]")) button.onclick = () => ask({ answer: button.dataset.answer });
submit("spot", () => ask({ show: `spot ${$("theta").value} ${$("phi").value}` }));
submit("expose", () => ask({ exposure_ms: number("exposure") }));
submit("amplify", () => ask({ gain: number("gain") }));
submit("tilted", () => ask({ hold: `mirror ${$("tilt").value} ${$("towards").value}` }));
submit("turn", () => {
  const [kind, axis] = $("motion").value.split(" ");
  ask({ move: { part: $("part").value, motion: { [kind]: Number(axis) }, by: number("by") } });
});
submit("misalign", () => ask({ misalign: { seed: number("seed"), position_mm: number("mm"), angle_deg: number("deg") } }));
$("auto").onclick = () => ask("auto_exposure");
$("run").onclick = () => ask({ run: !state?.running });
$("fire").onclick = () => ask("fire");
$("plug").onclick = () => ask({ plug: !state?.is_plugged });
$("advise").onclick = () => ask("advise");
$("follow").onclick = () => ask("follow");
$("calibrate").onclick = () => ask("calibrate");
$("outlines").onchange = drawImage;
$("report").onclick = async () => {
  // Opened at once: later it would count as none that hands have opened.
  const report = open("", "_blank");
  const answer = await fetch("/report", { method: "POST", headers: { Authorization: `Bearer ${token}` } });
  const text = (await answer.text()).trim();
  if (answer.ok) report.location = text;
  else { report.close(); complain(text); }
};
const KEYS = {
  b: () => ask({ show: "black" }), w: () => ask({ show: "white" }), c: () => ask({ show: "cross" }), s: () => ask({ show: "stripes" }),
  p: () => $("spot").requestSubmit(), a: () => $("auto").click(), " ": () => $("run").click(), f: () => $("fire").click(),
  o: () => $("outlines").click(),
};
document.addEventListener("keydown", (event) => {
  const is_writing = event.target.closest("input, select, textarea, button") && event.target.id !== "outlines";
  if (is_writing || event.ctrlKey || event.metaKey || event.altKey || !KEYS[event.key]) return;
  event.preventDefault();
  KEYS[event.key]();
});
connect();
