// Draws the views of the page from the values that it carries (their layout: `shown.rs`). One file of more than 500 lines: a page that
// is opened as a file can load no other.
"use strict";
(async () => {
  const $ = (id) => document.getElementById(id);
  const facts = JSON.parse($("facts").textContent);
  const { size, channels, incident_deg: lights, around: side } = facts;
  const cells = size * size;
  const state = $("state");
  if (lights.length === 0) {
    state.textContent = "No incident direction was lit: there is nothing to show.";
    return;
  }

  // ---- values -------------------------------------------------------------------------------------------------------
  const packed = Uint8Array.from(atob($("values").textContent), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  let at = 0;
  const take = (count) => bytes.subarray(at, (at += count));
  const HALF = new Float32Array(65536).map((_, bits) => {
    const exponent = (bits >> 10) & 31;
    const fraction = (bits & 1023) / 1024;
    const sign = bits & 32768 ? -1 : 1;
    if (exponent === 31) return fraction ? NaN : sign * Infinity;
    return sign * (exponent ? 2 ** (exponent - 15) * (1 + fraction) : 2 ** -14 * fraction);
  });
  const words = (count) => {
    const from = take(2 * count);
    return Uint16Array.from({ length: count }, (_, i) => from[2 * i] | (from[2 * i + 1] << 8));
  };
  const f = words(lights.length * cells * channels);
  const reference = facts.has_reference ? words(lights.length * cells * channels) : null;
  const sigma = take(lights.length * cells);
  const origin = take(lights.length * cells);
  const reason = take(cells);
  const near = words(4 * side * side);
  const weight = take(4 * side * side);
  const SIGMA = Float32Array.from({ length: 256 }, (_, code) =>
    code ? 10 ** ((facts.sigma.decades * (code - 1)) / 254 + facts.sigma.from_decade) : NaN);

  // ---- directions ---------------------------------------------------------------------------------------------------
  const DEG = Math.PI / 180;
  const direction = (theta, phi) => [
    Math.sin(theta * DEG) * Math.cos(phi * DEG), Math.sin(theta * DEG) * Math.sin(phi * DEG), Math.cos(theta * DEG)];
  const angles = ([x, y, z]) => [Math.acos(Math.min(1, z)) / DEG, (Math.atan2(y, x) / DEG + 360) % 360];
  // On a disk of radius 1: Lambert's azimuthal equal-area projection.
  const onDisk = ([x, y, z]) => [x / Math.sqrt(1 + z), y / Math.sqrt(1 + z)];
  const fromDisk = (x, y) => {
    const rr = x * x + y * y;
    return rr < 1 ? [x * Math.sqrt(2 - rr), y * Math.sqrt(2 - rr), 1 - rr] : null;
  };
  const cellOf = (w) => {
    const [x, y] = onDisk(w).map((c) => Math.min(size - 1, Math.floor(((c + 1) / 2) * size)));
    return y * size + x;
  };
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const lightDirections = lights.map(([theta, phi]) => direction(theta, phi));

  // ---- what is looked at --------------------------------------------------------------------------------------------
  const nearestLight = (w, but = -1) =>
    lightDirections.reduce((best, l, i) => (i !== but && (best < 0 || dot(l, w) > dot(lightDirections[best], w)) ? i : best), -1);
  const view = {
    light: nearestLight(direction(45, 0)), quantity: "log", channel: 0, cell: -1,
    yaw: -0.6, pitch: 0.5, lamp: direction(45, 90), exposure: 0, material: "measured",
  };
  const value = (table, cell, channel = view.channel) => HALF[table[(view.light * cells + cell) * channels + channel]];
  const relative = (cell) => SIGMA[sigma[view.light * cells + cell]];
  /** A quantity between cells: the mean of those around that have a value, by their nearness. */
  const between = (w, of) => {
    const [x, y] = onDisk(w).map((c) => ((c + 1) / 2) * size - 0.5);
    let [sum, weights] = [0, 0];
    for (const [i, j] of [[0, 0], [1, 0], [0, 1], [1, 1]]) {
      const [cx, cy] = [Math.floor(x) + i, Math.floor(y) + j];
      if (cx < 0 || cy < 0 || cx >= size || cy >= size) continue;
      const v = of(cy * size + cx);
      const share = (1 - Math.abs(x - cx)) * (1 - Math.abs(y - cy));
      if (Number.isFinite(v)) { sum += share * v; weights += share; }
    }
    return weights > 0.5 ? sum / weights : NaN;
  };
  const QUANTITIES = {
    log: { name: "f, logarithmic", unit: "1/sr", of: (cell) => value(f, cell), log: true },
    f: { name: "f", unit: "1/sr", of: (cell) => value(f, cell) },
    sigma: { name: "σ over f, least certain channel", unit: "", of: relative, log: true },
    origin: { name: "provenance", unit: "", of: (cell) => origin[view.light * cells + cell] || NaN, named: true },
  };
  if (reference) {
    QUANTITIES.difference = {
      name: "f over the reference, less 1", unit: "", signed: true,
      of: (cell) => value(f, cell) / value(reference, cell) - 1,
    };
    QUANTITIES.score = {
      name: "difference from the reference over σ", unit: "", signed: true,
      of: (cell) => (value(f, cell) - value(reference, cell)) / (relative(cell) * Math.abs(value(f, cell))),
    };
  }

  // ---- colours ------------------------------------------------------------------------------------------------------
  const STOPS = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
  const SIGNED = [[33, 102, 172], [146, 197, 222], [247, 247, 247], [244, 165, 130], [178, 24, 43]];
  const NAMED = [[0, 0, 0], [0, 114, 178], [86, 180, 233], [230, 159, 0], [204, 121, 167], [213, 94, 0]];
  const ramp = (stops, t) => {
    const p = Math.max(0, Math.min(1, t)) * (stops.length - 1);
    const i = Math.min(stops.length - 2, Math.floor(p));
    return stops[i].map((c, k) => c + (p - i) * (stops[i + 1][k] - c));
  };
  const hatch = (x, y) => ((x + y) % 8 < 2 ? [86, 74, 110] : [52, 46, 66]);
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const paper = () => css("--paper").match(/[0-9a-f]{2}/gi).map((x) => parseInt(x, 16));
  const shows = (x) => (x === 0 ? "0" : Math.abs(x) >= 1e4 || Math.abs(x) < 1e-2 ? x.toExponential(1) : x.toPrecision(3));

  /** Range of a quantity over the hemisphere of the chosen light, and where a value lies in it. */
  const range = (quantity) => {
    const all = [];
    for (let cell = 0; cell < cells; cell++) {
      const v = quantity.of(cell);
      if (Number.isFinite(v) && (!quantity.log || v > 0)) all.push(v);
    }
    all.sort((a, b) => a - b);
    let [low, high] = all.length ? [all[Math.floor(0.01 * all.length)], all[all.length - 1]] : [0, 1];
    if (quantity.signed) {
      high = all.map(Math.abs).sort((a, b) => a - b)[Math.floor(0.98 * all.length)] || 1;
      low = -high;
    } else if (!quantity.log) low = Math.min(0, low);
    if (!(high > low)) high = quantity.log ? low * 1.01 : low + 1;
    const place = quantity.log
      ? (v) => (v > 0 ? Math.log(v / low) / Math.log(high / low) : 0)
      : (v) => (v - low) / (high - low);
    return { low, high, place };
  };
  const colour = (quantity, r, v) => (quantity.named ? NAMED[v] : ramp(quantity.signed ? SIGNED : STOPS, r.place(v)));

  // ---- canvases -----------------------------------------------------------------------------------------------------
  const EDGE = 640;
  const canvases = Object.fromEntries(["light", "hemisphere", "plane", "lobe", "sphere"].map((id) => [id, $(id)]));
  for (const canvas of Object.values(canvases)) canvas.width = canvas.height = EDGE;
  const flat = Object.fromEntries(["light", "hemisphere", "plane"].map((id) => [id, canvases[id].getContext("2d")]));
  const cleared = (id) => {
    const pen = flat[id];
    pen.fillStyle = css("--paper");
    pen.fillRect(0, 0, EDGE, EDGE);
    pen.font = "22px system-ui, sans-serif";
    pen.lineWidth = 2;
    return pen;
  };
  const RADIUS = 0.44 * EDGE;
  const MIDDLE = EDGE / 2;
  const toCanvas = (w) => onDisk(w).map((c, k) => MIDDLE + (k ? -1 : 1) * c * RADIUS);
  const fromCanvas = (x, y) => fromDisk((x - MIDDLE) / RADIUS, (MIDDLE - y) / RADIUS);
  const rings = (pen) => {
    pen.strokeStyle = css("--line");
    pen.fillStyle = css("--faint");
    for (const theta of [30, 60, 90]) {
      pen.beginPath();
      pen.arc(MIDDLE, MIDDLE, RADIUS * Math.SQRT2 * Math.sin((theta / 2) * DEG), 0, 2 * Math.PI);
      pen.stroke();
      const [x, y] = toCanvas(direction(theta, 90));
      pen.fillText(`${theta}°`, x + 6, y + (theta === 90 ? -6 : 24));
    }
    pen.fillText("φ = 0", EDGE - 66, MIDDLE - 8);
  };
  const circle = (pen, [x, y], radius, fill) => {
    pen.beginPath();
    pen.arc(x, y, radius, 0, 2 * Math.PI);
    if (fill) pen.fill();
    else pen.stroke();
  };

  const drawLights = () => {
    const pen = cleared("light");
    rings(pen);
    const dot = lights.length > 120 ? 4 : 6;
    pen.strokeStyle = css("--faint");
    for (const [theta, phi] of facts.unlit_deg) circle(pen, toCanvas(direction(theta, phi)), dot, false);
    pen.fillStyle = css("--ink");
    for (const w of lightDirections) circle(pen, toCanvas(w), dot, true);
    pen.fillStyle = css("--mark");
    circle(pen, toCanvas(lightDirections[view.light]), 11, true);
  };

  const drawHemisphere = () => {
    const pen = cleared("hemisphere");
    const quantity = QUANTITIES[view.quantity];
    const r = range(quantity);
    const image = new ImageData(EDGE, EDGE);
    const behind = paper();
    for (let y = 0; y < EDGE; y++) {
      for (let x = 0; x < EDGE; x++) {
        const w = fromCanvas(x + 0.5, y + 0.5);
        let c = behind;
        if (w) {
          const v = quantity.of(cellOf(w));
          c = Number.isNaN(v) ? hatch(x >> 1, y >> 1) : colour(quantity, r, v);
        }
        image.data.set([...c, 255], 4 * (y * EDGE + x));
      }
    }
    pen.putImageData(image, 0, 0);
    rings(pen);
    const [lx, ly, lz] = lightDirections[view.light];
    pen.strokeStyle = css("--mark");
    pen.lineWidth = 3;
    circle(pen, toCanvas([lx, ly, lz]), 9, false);
    const [mx, my] = toCanvas([-lx, -ly, lz]);
    pen.beginPath();
    pen.moveTo(mx - 9, my - 9); pen.lineTo(mx + 9, my + 9);
    pen.moveTo(mx - 9, my + 9); pen.lineTo(mx + 9, my - 9);
    pen.stroke();
    if (view.cell >= 0) {
      const w = fromDisk((2 * ((view.cell % size) + 0.5)) / size - 1, (2 * (Math.floor(view.cell / size) + 0.5)) / size - 1);
      if (w) { pen.strokeStyle = css("--ink"); circle(pen, toCanvas(w), 14, false); }
    }
    drawScale(pen, quantity, r);
  };

  /** The colours and what they mean, below the hemisphere. */
  const drawScale = (pen, quantity, r) => {
    const [left, top, width, height] = [20, EDGE - 34, EDGE - 40, 14];
    pen.fillStyle = css("--ink");
    if (quantity.named) {
      let x = left;
      facts.origins.forEach((name, code) => {
        if (code === 0) return;
        pen.fillStyle = `rgb(${NAMED[code]})`;
        pen.fillRect(x, top + 2, 14, 14);
        pen.fillStyle = css("--ink");
        pen.fillText(name, x + 18, top + 18);
        x += 34 + pen.measureText(name).width;
      });
      return;
    }
    for (let x = 0; x < width; x++) {
      pen.fillStyle = `rgb(${ramp(quantity.signed ? SIGNED : STOPS, x / width).map(Math.round)})`;
      pen.fillRect(left + x, top, 1.5, height);
    }
    pen.fillStyle = css("--ink");
    pen.fillText(`${shows(r.low)}`, left, top - 6);
    const high = `${shows(r.high)} ${quantity.unit}`;
    pen.fillText(high, left + width - pen.measureText(high).width, top - 6);
  };

  const drawPlane = () => {
    const pen = cleared("plane");
    const [lx, ly] = lightDirections[view.light];
    const azimuth = Math.hypot(lx, ly) > 1e-6 ? Math.atan2(-ly, -lx) / DEG : 0;
    const log = view.quantity === "log";
    const points = [];
    for (let theta = -88; theta <= 88; theta += 2) {
      const w = direction(Math.abs(theta), theta < 0 ? azimuth + 180 : azimuth);
      points.push({
        theta,
        f: between(w, (cell) => value(f, cell)),
        sigma: between(w, (cell) => relative(cell) * Math.abs(value(f, cell))),
        reference: reference ? between(w, (cell) => value(reference, cell)) : NaN,
      });
    }
    const all = points.flatMap((p) => [p.f, p.reference]).filter((v) => Number.isFinite(v) && (!log || v > 0));
    const high = Math.max(...all, 1e-9) * 1.1;
    const low = log ? Math.max(Math.min(...all) / 1.3, high / 1e6) : 0;
    const [left, right, top, bottom] = [76, EDGE - 16, 20, EDGE - 60];
    const px = (theta) => left + ((theta + 90) / 180) * (right - left);
    const share = (v) => (log ? Math.log(Math.max(v, low) / low) / Math.log(high / low) : v / high);
    const py = (v) => bottom - Math.max(0, Math.min(1, share(v))) * (bottom - top);
    pen.strokeStyle = css("--line");
    pen.fillStyle = css("--faint");
    for (let theta = -90; theta <= 90; theta += 30) {
      pen.beginPath(); pen.moveTo(px(theta), top); pen.lineTo(px(theta), bottom); pen.stroke();
      pen.fillText(`${theta}°`, px(theta) - 18, bottom + 26);
    }
    const ticks = log
      ? Array.from({ length: 20 }, (_, k) => 10 ** (Math.ceil(Math.log10(low)) + k)).filter((v) => v <= high)
      : [0.25, 0.5, 0.75, 1].map((t) => t * high / 1.1);
    for (const v of ticks) {
      pen.beginPath(); pen.moveTo(left, py(v)); pen.lineTo(right, py(v)); pen.stroke();
      pen.fillText(shows(v), 2, py(v) + 8);
    }
    pen.fillText("θ of view, mirror side positive; f in 1/sr", left + 60, EDGE - 8);
    // What is uncertain, k = 2.
    const mark = css("--mark");
    pen.fillStyle = mark;
    pen.globalAlpha = 0.25;
    for (const p of points) {
      if (!Number.isFinite(p.f)) continue;
      const [a, b] = [py(p.f + 2 * p.sigma), py(p.f - 2 * p.sigma)];
      pen.fillRect(px(p.theta) - 3, a, 6, Math.max(1, b - a));
    }
    pen.globalAlpha = 1;
    const line = (of, stroke, dash) => {
      pen.strokeStyle = stroke;
      pen.lineWidth = 3;
      pen.setLineDash(dash);
      pen.beginPath();
      let down = false;
      for (const p of points) {
        const v = of(p);
        if (!Number.isFinite(v) || (log && v <= 0)) { down = false; continue; }
        if (down) pen.lineTo(px(p.theta), py(v));
        else pen.moveTo(px(p.theta), py(v));
        down = true;
      }
      pen.stroke();
      pen.setLineDash([]);
    };
    if (reference) line((p) => p.reference, css("--faint"), [10, 8]);
    line((p) => p.f, mark, []);
  };

  // ---- WebGL2 -------------------------------------------------------------------------------------------------------
  const context = (id, vertex, fragment) => {
    const gl = canvases[id].getContext("webgl2", { preserveDrawingBuffer: true, antialias: true });
    if (!gl) return null;
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, `#version 300 es\nprecision highp float;\nprecision highp int;\n${source}`);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    gl.useProgram(program);
    return { gl, at: (name) => gl.getUniformLocation(program, name), program, buffer: gl.createBuffer() };
  };
  const without = (id) => {
    canvases[id].replaceWith(Object.assign(document.createElement("p"), { textContent: "This browser has no WebGL2: this view is not drawn." }));
  };

  const lobe = context("lobe",
    `in vec3 place; in vec3 tint; uniform mat3 turn; out vec3 c;
     void main() { vec3 p = turn * (place - vec3(0., 0., .35)); c = tint; gl_Position = vec4(p.x * .92, p.z * .92, p.y * .4, 1.); }`,
    `in vec3 c; out vec4 o; void main() { o = vec4(c, 1.); }`);
  const drawLobe = () => {
    if (!lobe) return;
    const { gl } = lobe;
    const quantity = view.quantity === "f" ? QUANTITIES.f : QUANTITIES.log;
    const r = range(quantity);
    const data = [];
    const STEPS = 120;
    const ROWS = 44;
    const point = (i, j) => {
      const w = direction((88 * i) / ROWS, (360 * j) / STEPS);
      const v = between(w, quantity.of);
      const length = Number.isFinite(v) ? 0.02 + 0.93 * Math.max(0, Math.min(1, r.place(v))) : 0;
      const tint = Number.isFinite(v) ? colour(quantity, r, v) : hatch(i, j);
      return [...w.map((x) => x * length), ...tint.map((x) => x / 255)];
    };
    for (let i = 0; i < ROWS; i++) {
      for (let j = 0; j < STEPS; j++) {
        const [a, b, c, d] = [point(i, j), point(i + 1, j), point(i + 1, j + 1), point(i, j + 1)];
        data.push(...a, ...b, ...c, ...a, ...c, ...d);
      }
    }
    const faces = data.length / 6;
    // The horizon, φ = 0, and the way that the light comes.
    const grey = [0.54, 0.56, 0.6];
    for (let j = 0; j < STEPS; j++) {
      for (const k of [j, j + 1]) data.push(...direction(90, (360 * k) / STEPS), ...grey);
    }
    data.push(0, 0, 0, ...grey, 1, 0, 0, ...grey);
    data.push(0, 0, 0, 0.92, 0.4, 0.1, ...lightDirections[view.light], 0.92, 0.4, 0.1);
    gl.bindBuffer(gl.ARRAY_BUFFER, lobe.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(data), gl.STREAM_DRAW);
    ["place", "tint"].forEach((name, k) => {
      const where = gl.getAttribLocation(lobe.program, name);
      gl.enableVertexAttribArray(where);
      gl.vertexAttribPointer(where, 3, gl.FLOAT, false, 24, 12 * k);
    });
    const [cy, sy, cp, sp] = [Math.cos(view.yaw), Math.sin(view.yaw), Math.cos(view.pitch), Math.sin(view.pitch)];
    // Columns: about z by the yaw, then towards the eye by the pitch.
    gl.uniformMatrix3fv(lobe.at("turn"), false, [cy, sy * cp, -sy * sp, -sy, cy * cp, -cy * sp, 0, sp, cp]);
    gl.clearColor(...paper().map((c) => c / 255), 1);
    gl.enable(gl.DEPTH_TEST);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.drawArrays(gl.TRIANGLES, 0, faces);
    gl.drawArrays(gl.LINES, faces, data.length / 6 - faces);
  };

  // Between incident directions what is seen about the half vector is taken from each of those around (a lobe stays one lobe).
  const ball = context("sphere",
    `in vec2 place; out vec2 p; void main() { p = place; gl_Position = vec4(place, 0., 1.); }`,
    `precision highp sampler2DArray; precision highp usampler2D; precision highp sampler2D;
     uniform sampler2DArray table; uniform sampler2D lights; uniform usampler2D near; uniform sampler2D share;
     uniform vec3 lamp; uniform float white; uniform int size; uniform int side;
     in vec2 p; out vec4 o;
     vec2 onDisk(vec3 w) { return w.xy / sqrt(1. + w.z); }
     vec4 look(int layer, vec3 w) {
       vec2 at = (onDisk(w) + 1.) * .5 * float(size) - .5;
       ivec2 low = ivec2(floor(at)); vec2 t = at - floor(at); vec4 sum = vec4(0.);
       for (int k = 0; k < 4; k++) {
         ivec2 q = ivec2(k & 1, k >> 1);
         vec4 v = texelFetch(table, ivec3(clamp(low + q, ivec2(0), ivec2(size - 1)), layer), 0);
         float g = (q.x == 1 ? t.x : 1. - t.x) * (q.y == 1 ? t.y : 1. - t.y);
         sum += g * v.a * vec4(v.rgb, 1.);
       }
       return sum;
     }
     vec4 f(vec3 wi, vec3 wo) {
       vec2 at = (onDisk(wi) + 1.) * .5 * float(side);
       ivec2 cell = clamp(ivec2(at), ivec2(0), ivec2(side - 1));
       uvec4 layers = texelFetch(near, cell, 0); vec4 shares = texelFetch(share, cell, 0);
       vec3 h = normalize(wi + wo); vec4 sum = vec4(0.);
       for (int k = 0; k < 4; k++) {
         if (shares[k] <= 0.) continue;
         vec3 l = texelFetch(lights, ivec2(int(layers[k]), 0), 0).xyz;
         vec3 v = 2. * dot(l, h) * h - l;
         sum += shares[k] * look(int(layers[k]), v.z > .02 ? v : wo);
       }
       return sum;
     }
     vec3 srgb(vec3 c) { c = clamp(c, 0., 1.); return mix(12.92 * c, 1.055 * pow(c, vec3(1. / 2.4)) - .055, step(.0031308, c)); }
     void main() {
       vec2 q = p / .96; float rr = dot(q, q);
       if (rr >= 1.) { o = vec4(24., 26., 30., 255.) / 255.; return; }
       vec3 n = vec3(q, sqrt(1. - rr));
       if (dot(lamp, n) <= 1e-6) { o = vec4(0., 0., 0., 1.); return; }
       vec3 x = normalize(cross(vec3(0., 1., 0.), n)), y = cross(n, x);
       vec3 wi = vec3(dot(lamp, x), dot(lamp, y), dot(lamp, n)), wo = vec3(x.z, y.z, n.z);
       vec4 v = f(wi, wo);
       if (v.a < .5) {
         ivec2 d = ivec2(gl_FragCoord.xy) / 2;
         o = vec4((d.x - d.y + 4096) % 8 < 2 ? vec3(86., 74., 110.) : vec3(52., 46., 66.), 255.) / 255.; return;
       }
       o = vec4(srgb(v.rgb / v.a * wi.z * white), 1.);
     }`);
  const tables = {};
  if (ball) {
    const { gl } = ball;
    const texture = (unit, kind) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(kind, gl.createTexture());
      for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(kind, name, gl.NEAREST);
    };
    /** Lanes r, g, b and whether there is a value. */
    const lanes = (table) => {
      const all = new Uint16Array(4 * lights.length * cells);
      for (let i = 0; i < lights.length * cells; i++) {
        const missing = origin[i] === 0;
        for (let k = 0; k < 3; k++) all[4 * i + k] = missing ? 0 : table[i * channels + Math.min(k, channels - 1)];
        all[4 * i + 3] = missing ? 0 : 0x3c00;
      }
      return all;
    };
    const upload = (unit, table) => {
      texture(unit, gl.TEXTURE_2D_ARRAY);
      gl.texImage3D(gl.TEXTURE_2D_ARRAY, 0, gl.RGBA16F, size, size, lights.length, 0, gl.RGBA, gl.HALF_FLOAT, lanes(table));
      return unit;
    };
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    tables.measured = upload(0, f);
    if (reference) tables.reference = upload(4, reference);
    texture(1, gl.TEXTURE_2D);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, lights.length, 1, 0, gl.RGBA, gl.FLOAT,
      Float32Array.from(lightDirections.flatMap((w) => [...w, 0])));
    texture(2, gl.TEXTURE_2D);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA16UI, side, side, 0, gl.RGBA_INTEGER, gl.UNSIGNED_SHORT, near);
    texture(3, gl.TEXTURE_2D);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, side, side, 0, gl.RGBA, gl.UNSIGNED_BYTE, weight);
    gl.uniform1i(ball.at("lights"), 1);
    gl.uniform1i(ball.at("near"), 2);
    gl.uniform1i(ball.at("share"), 3);
    gl.uniform1i(ball.at("size"), size);
    gl.uniform1i(ball.at("side"), side);
    gl.bindBuffer(gl.ARRAY_BUFFER, ball.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([-1, -1, 3, -1, -1, 3]), gl.STATIC_DRAW);
    const where = gl.getAttribLocation(ball.program, "place");
    gl.enableVertexAttribArray(where);
    gl.vertexAttribPointer(where, 2, gl.FLOAT, false, 0, 0);
  }
  // White is what most values of f·cosθ stay below.
  const white = (() => {
    const levels = [];
    for (let i = 0; i < f.length; i += 37) if (HALF[f[i]] > 0) levels.push(HALF[f[i]]);
    levels.sort((a, b) => a - b);
    return 1 / (levels[Math.floor(0.97 * levels.length)] || 1);
  })();
  const drawSphere = () => {
    if (!ball) return;
    const { gl } = ball;
    gl.uniform1i(ball.at("table"), tables[view.material]);
    gl.uniform3fv(ball.at("lamp"), view.lamp);
    gl.uniform1f(ball.at("white"), white * 2 ** view.exposure);
    gl.viewport(0, 0, EDGE, EDGE);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  };
  if (!lobe) without("lobe");
  if (!ball) without("sphere");

  // ---- words --------------------------------------------------------------------------------------------------------
  const NAMES = channels === 1 ? ["f"] : facts.bands || ["red", "green", "blue"];
  const say = () => {
    const [theta, phi] = lights[view.light];
    const parts = [`Light from θ ${theta.toFixed(1)}°, φ ${phi.toFixed(1)}° (${lights.length} of ${facts.incident_measured} directions are here).`];
    if (view.cell >= 0) {
      const w = fromDisk((2 * ((view.cell % size) + 0.5)) / size - 1, (2 * (Math.floor(view.cell / size) + 0.5)) / size - 1);
      const [to, po] = w ? angles(w) : [NaN, NaN];
      const code = origin[view.light * cells + view.cell];
      const told = code
        ? `f = ${NAMES.map((_, c) => shows(value(f, view.cell, c))).join(", ")} 1/sr, σ ${(100 * relative(view.cell)).toPrecision(2)} %, ${facts.origins[code]}`
          + (reference ? `; reference ${NAMES.map((_, c) => shows(value(reference, view.cell, c))).join(", ")}` : "")
        : `no value: ${facts.reasons[reason[view.cell]] || "not measured with this light"}`;
      parts.push(`Seen from θ ${to.toFixed(1)}°, φ ${po.toFixed(1)}°: ${told}.`);
    }
    const block = Math.round(facts.measured_size / size);
    if (block > 1) parts.push(`Cells here are means of ${block} × ${block} of the file's.`);
    const [tl, pl] = angles(view.lamp);
    parts.push(`Lamp of the sphere at θ ${tl.toFixed(0)}°, φ ${pl.toFixed(0)}°.`);
    state.textContent = parts.join(" ");
  };
  let waiting = false;
  const draw = () => {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      drawLights(); drawHemisphere(); drawPlane(); drawLobe(); drawSphere(); say();
    });
  };

  // ---- hands --------------------------------------------------------------------------------------------------------
  const controls = $("controls");
  const select = (key, label, options) => {
    const box = document.createElement("select");
    box.id = `choose-${key}`;
    for (const [name, text] of options) box.add(new Option(text, name, false, String(view[key]) === String(name)));
    box.addEventListener("change", () => { view[key] = key === "channel" ? Number(box.value) : box.value; draw(); });
    const frame = document.createElement("label");
    frame.append(label, box);
    controls.append(frame);
  };
  select("quantity", "Shown", Object.entries(QUANTITIES).map(([key, quantity]) => [key, quantity.name]));
  if (channels > 1) select("channel", "Channel", NAMES.map((name, c) => [c, name]));
  if (reference) select("material", "Sphere of", [["measured", "what was measured"], ["reference", facts.reference || "the reference"]]);
  const slider = Object.assign(document.createElement("input"), { type: "range", min: -6, max: 6, step: 0.25, value: 0, id: "choose-exposure" });
  slider.addEventListener("input", () => { view.exposure = Number(slider.value); draw(); });
  const frame = document.createElement("label");
  frame.append("Exposure of the sphere", slider);
  controls.append(frame);

  const place = (canvas, event) => {
    const box = canvas.getBoundingClientRect();
    return [((event.clientX - box.left) / box.width) * EDGE, ((event.clientY - box.top) / box.height) * EDGE];
  };
  /** Follows a pointer that is down (or merely there, if `hovers`), and the arrow keys. */
  const follow = (id, onPointer, onKey, hovers = false) => {
    const canvas = canvases[id];
    let last = null;
    const move = (event) => {
      const now = place(canvas, event);
      onPointer(now, last || now);
      last = now;
      draw();
    };
    canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); last = null; move(event); });
    canvas.addEventListener("pointermove", (event) => { if (hovers || event.buttons) move(event); });
    canvas.addEventListener("pointerup", () => { last = null; });
    canvas.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
      if (!step) return;
      event.preventDefault();
      onKey(step);
      draw();
    });
  };
  /** A direction that is moved on a disk by a step; at its border it stays. */
  const stepped = (w, [dx, dy], length) => {
    const [x, y] = onDisk(w);
    return fromDisk(x + dx * length, y + dy * length) || w;
  };
  follow("light", ([x, y]) => {
    const w = fromCanvas(x, y);
    if (w) view.light = nearestLight(w);
  }, (step) => {
    const from = onDisk(lightDirections[view.light]);
    // The nearest of those that lie that way.
    let best = [-1, Infinity];
    lightDirections.forEach((w, i) => {
      const [dx, dy] = onDisk(w).map((c, k) => c - from[k]);
      const along = dx * step[0] + dy * step[1];
      const aside = Math.abs(dx * step[1]) + Math.abs(dy * step[0]);
      if (i !== view.light && along > 1e-6 && aside <= along && Math.hypot(dx, dy) < best[1]) best = [i, Math.hypot(dx, dy)];
    });
    if (best[0] >= 0) view.light = best[0];
  });
  follow("hemisphere", ([x, y]) => {
    const w = fromCanvas(x, y);
    view.cell = w ? cellOf(w) : -1;
  }, ([dx, dy]) => {
    const from = view.cell < 0 ? cellOf([0, 0, 1]) : view.cell;
    const [x, y] = [(from % size) + dx, Math.floor(from / size) + dy];
    if (x >= 0 && y >= 0 && x < size && y < size && fromDisk((2 * (x + 0.5)) / size - 1, (2 * (y + 0.5)) / size - 1)) view.cell = y * size + x;
  }, true);
  const turn = (yaw, pitch) => {
    view.yaw += yaw;
    view.pitch = Math.max(0, Math.min(Math.PI / 2, view.pitch + pitch));
  };
  follow("lobe", ([x, y], [a, b]) => turn(0.008 * (x - a), 0.008 * (y - b)), ([dx, dy]) => turn(0.15 * dx, -0.15 * dy));
  follow("sphere", ([x, y]) => {
    const [p, q] = [(x - MIDDLE) / (0.48 * EDGE), (MIDDLE - y) / (0.48 * EDGE)];
    const rr = Math.min(0.999, Math.hypot(p, q)) ** 2;
    const scale = Math.sqrt(rr) / (Math.hypot(p, q) || 1);
    view.lamp = [p * scale, q * scale, Math.sqrt(1 - rr)];
  }, (step) => { view.lamp = stepped(view.lamp, step, 0.06); });

  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  addEventListener("beforeprint", () => { drawLights(); drawHemisphere(); drawPlane(); drawLobe(); drawSphere(); });
  draw();
  document.documentElement.dataset.ready = "yes";
})().catch((error) => {
  document.getElementById("state").textContent = `The views cannot be drawn: ${error.message}`;
  console.error(error);
});
