// The rig as a picture that can be turned: an orthographic frame with a little perspective, drawn as SVG.
// The scene (JSON beside the picture) is in the base frame, in metres; without this script the picture stands alone.
document.querySelectorAll("script.scene").forEach(function (data) {
  "use strict";
  var s = JSON.parse(data.textContent), figure = data.closest("figure"), box = make("div", { class: "turn", role: "group" });
  var START = [-58, 22], view = START.slice(), zoom = 1, chosen = s.chosen, width = 0, height = 0, asked = false;
  box.setAttribute("aria-label", s.label);
  var stage = make("div", { class: "stage", tabindex: "0", role: "img", "aria-label": s.alt + " " + s.help });
  var bar = make("div", { class: "bar" }), said = make("span", {});
  var slider = make("input", { type: "range", min: 0, max: s.poses.length - 1, value: chosen, "aria-label": s.item });
  [["Side", START], ["Front", [0, 8]], ["Above", [-90, 90]]].forEach(function (it) {
    button(it[0], "Seen from: " + it[0].toLowerCase(), function () { view = it[1].slice(); });
  });
  button("\u2212", "Smaller", function () { zoom /= 1.25; });
  button("+", "Larger", function () { zoom *= 1.25; });
  var line = make("label", { class: "pose" });
  line.append(slider, said);
  box.append(stage, bar, line, Object.assign(make("p", { class: "help" }), { textContent: s.help }));
  figure.insertBefore(box, figure.firstChild);
  figure.classList.add("turned");

  function make(name, attributes) {
    var e = document.createElement(name);
    Object.keys(attributes).forEach(function (key) { e.setAttribute(key, attributes[key]); });
    return e;
  }
  function button(text, label, act) {
    var e = make("button", { type: "button", "aria-label": label, title: label });
    e.textContent = text;
    e.addEventListener("click", function () { act(); draw(); });
    bar.append(e);
  }
  // Poses are rows of 3x4.
  function at(T, p) {
    return [0, 4, 8].map(function (i) { return T[i] * p[0] + T[i + 1] * p[1] + T[i + 2] * p[2] + T[i + 3]; });
  }
  function times(A, B) {
    var out = [];
    [0, 4, 8].forEach(function (i) {
      for (var j = 0; j < 4; j++) out.push(A[i] * B[j] + A[i + 1] * B[j + 4] + A[i + 2] * B[j + 8] + (j === 3 ? A[i + 3] : 0));
    });
    return out;
  }
  function draw() {
    if (asked) return;
    asked = true;
    requestAnimationFrame(function () { asked = false; paint(); });
  }
  function paint() {
    width = stage.clientWidth;
    height = Math.round(Math.min(0.78 * width, 460));
    if (!width) return;
    var a = view[0] * Math.PI / 180, e = view[1] * Math.PI / 180, c = Math.cos, n = Math.sin;
    var right = [-n(a), c(a), 0], up = [-n(e) * c(a), -n(e) * n(a), c(e)], away = [-c(e) * c(a), -c(e) * n(a), -n(e)];
    var mid = s.low.map(function (x, i) { return (x + s.high[i]) / 2; });
    var reach = Math.hypot(s.high[0] - s.low[0], s.high[1] - s.low[1], s.high[2] - s.low[2]) / 2;
    var scale = zoom * 0.5 * Math.min(1.06 * width, 1.4 * height) / reach, items = [];
    function dot(v, p) { return v[0] * (p[0] - mid[0]) + v[1] * (p[1] - mid[1]) + v[2] * (p[2] - mid[2]); }
    function seen(p) {
      var z = dot(away, p), k = scale / (1 + z / (5 * reach));
      return [width / 2 + k * dot(right, p), height / 2 - k * dot(up, p), z];
    }
    function path(kind, points, front) {
      var q = points.map(seen), z = 0;
      var d = q.map(function (x, i) { z += x[2] / q.length; return (i ? "L" : "M") + x[0].toFixed(1) + " " + x[1].toFixed(1); });
      items.push([z - (front || 0), '<path class="' + kind + '" d="' + d.join("") + '"/>']);
    }
    function word(kind, p, text, dx, dy) {
      var q = seen(p), to = q[0] + dx, side = dx < -6 || to > width - 52 ? "end" : dx > 6 || to < 52 ? "start" : "middle";
      items.push([-1e3, '<text class="' + kind + '" x="' + to.toFixed(1) + '" y="' + (q[1] + dy + 4).toFixed(1) +
        '" text-anchor="' + side + '">' + text + "</text>"]);
    }
    function axes(T, size, bold) {
      ["x", "y", "z"].forEach(function (name, i) {
        var tip = [0, 0, 0];
        tip[i] = size;
        path("axis-" + name + bold, [at(T, [0, 0, 0]), at(T, tip)]);
      });
    }
    function place(corners, T) { return corners.map(function (p) { return at(T, p); }); }
    function board(T) { return place(s.board.concat([s.board[0], s.middle]), T); }
    function pyramid(T, size) {
      var w = 0.6 * size, h = 0.45 * size, p = place([[-w, -h, size], [w, -h, size], [w, h, size], [-w, h, size], [0, 0, 0]], T);
      return [p[0], p[1], p[2], p[3], p[0], p[4], p[1], p[2], p[4], p[3]];
    }
    var unit = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0], small = 0.05 * s.size, floor = 2e3, g = s.grid, x, y;
    // The plane z = 0 of the base, behind everything (in front of it, seen from below).
    var low = s.low.map(function (v) { return g * Math.floor(v / g); }), high = s.high.map(function (v) { return g * Math.ceil(v / g); });
    for (x = low[0]; x < high[0] + g / 2; x += g) path("floor", [[x, low[1], 0], [x, high[1], 0]], view[1] < 0 ? floor : -floor);
    for (y = low[1]; y < high[1] + g / 2; y += g) path("floor", [[low[0], y, 0], [high[0], y, 0]], view[1] < 0 ? floor : -floor);
    s.dots.forEach(function (p) { var q = seen(p); items.push([q[2], '<circle class="dot" cx="' + q[0].toFixed(1) + '" cy="' + q[1].toFixed(1) + '" r="1.6"/>']); });
    axes(unit, 3 * small, " bold");
    ["x", "y", "z"].forEach(function (name, i) { var p = [0, 0, 0]; p[i] = 3.6 * small; word("name-" + name, p, name, 0, 0); });
    var camera, target, camera0, target0;
    s.poses.forEach(function (G, k) {
      var it = k === chosen, bad = s.rejected.indexOf(k) >= 0;
      camera = s.hand ? times(G, s.X) : s.X;
      target = s.hand ? s.W : times(G, s.W);
      if (it) { camera0 = camera; target0 = target; }
      var moved = s.hand ? camera : target, hand = at(G, [0, 0, 0]), end = at(moved, [0, 0, 0]);
      path(it && s.hand ? "X" : "link", [hand, end], it ? small : 0);
      axes(G, it ? 1.6 * small : 0.5 * small, it ? " bold" : "");
      if (bad) {
        var q = seen(hand);
        items.push([-900, '<path class="bad" d="M' + (q[0] - 4) + " " + (q[1] - 4) + "l8 8m0-8l-8 8" + '"/>']);
      }
      if (s.hand) path((it ? "camera bold" : "camera") + (bad ? " off" : ""), pyramid(camera, small));
      else path((it ? "target bold" : "target") + (bad ? " off" : ""), board(target));
    });
    if (s.hand) path("target bold", board(s.W));
    else { path("camera bold", pyramid(s.X, 2 * small)); path("X", [[0, 0, 0], at(s.X, [0, 0, 0])], small); }
    var eye = at(camera0, [0, 0, 0]), middle = place([s.middle], target0)[0];
    path("sight", [eye, middle], small);
    axes(camera0, 1.4 * small, " bold");
    if (s.half) {
      var parent = s.hand ? s.poses[chosen] : unit;
      [[0, 1], [1, 2], [0, 2]].forEach(function (pair) {
        var ring = [], j, i, u, t;
        for (j = 0; j <= 48; j++) {
          t = 2 * Math.PI * j / 48;
          u = [0, 0, 0];
          for (i = 0; i < 3; i++) {
            u[i] = s.X[4 * i + 3] + c(t) * s.half[3 * i + pair[0]] + n(t) * s.half[3 * i + pair[1]];
          }
          ring.push(at(parent, u));
        }
        path("ring", ring, 2 * small);
      });
    }
    // Names stand away from the line of X, which they would cover.
    var from = s.hand ? at(s.poses[chosen], [0, 0, 0]) : [0, 0, 0], p0 = seen(from), p1 = seen(eye);
    var long = Math.hypot(p1[0] - p0[0], p1[1] - p0[1]) || 1, u0 = (p1[0] - p0[0]) / long, v0 = (p1[1] - p0[1]) / long;
    word("name-X", from.map(function (v, i) { return (v + eye[i]) / 2; }), "X", 11 * v0, -11 * u0);
    var clear = 14 + (s.half ? scale * Math.hypot.apply(null, s.half) / 1.4 : 0);
    word("name-camera", eye, "camera", clear * u0, clear * v0);
    if (s.hand) word("name", from, "gripper", -16 * u0, -16 * v0);
    else word("name", at(s.poses[chosen], [0, 0, 0]), "gripper", 0, -14);
    word("name", [0, 0, 0], "base", 0, 14);
    word("name-target", middle, "target", 0, 16);
    items.sort(function (p, q) { return q[0] - p[0]; });
    stage.innerHTML = '<svg aria-hidden="true" focusable="false" width="' + width + '" height="' + height + '" viewBox="0 0 ' + width + " " + height + '">' +
      items.map(function (it) { return it[1]; }).join("") + '<text class="scale" x="6" y="' + (height - 8) + '">' + s.grid_text + "</text></svg>";
    said.textContent = s.names[chosen];
    slider.setAttribute("aria-valuetext", s.names[chosen]);
  }
  function turn(right, up) {
    view = [(view[0] - right + 540) % 360 - 180, Math.max(-90, Math.min(90, view[1] + up))];
    draw();
  }
  var held = null;
  stage.addEventListener("pointerdown", function (event) {
    held = [event.clientX, event.clientY];
    stage.setPointerCapture(event.pointerId);
  });
  stage.addEventListener("pointermove", function (event) {
    if (!held) return;
    turn(0.5 * (event.clientX - held[0]), 0.5 * (event.clientY - held[1]));
    held = [event.clientX, event.clientY];
  });
  ["pointerup", "pointercancel"].forEach(function (name) { stage.addEventListener(name, function () { held = null; }); });
  stage.addEventListener("keydown", function (event) {
    var step = { ArrowLeft: [-5, 0], ArrowRight: [5, 0], ArrowUp: [0, 5], ArrowDown: [0, -5] }[event.key];
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (step) turn(step[0], step[1]);
    else if (event.key === "+" || event.key === "=") { zoom *= 1.25; draw(); }
    else if (event.key === "-") { zoom /= 1.25; draw(); }
    else if (event.key === "Home" || event.key === "0") { view = START.slice(); zoom = 1; draw(); }
    else return;
    event.preventDefault();
  });
  slider.addEventListener("input", function () { chosen = +slider.value; draw(); });
  new ResizeObserver(draw).observe(stage);
  paint();
});
