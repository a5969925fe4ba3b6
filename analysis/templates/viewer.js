// Bodies of this page: flat-shaded polygons on a 2D canvas, sorted from back to front.
window.lcbayes = window.lcbayes || {};
(function (lcbayes) {
  "use strict";
  const LIGHT = unit([-0.35, 0.45, 0.82]);  // right, up, towards the reader

  function unit(v) { const n = Math.hypot(...v) || 1; return v.map((x) => x / n); }
  function dot(a, b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

  // Newell's formula: good for any plane polygon
  function normal(points) {
    const n = [0, 0, 0];
    points.forEach((a, i) => {
      const b = points[(i + 1) % points.length];
      n[0] += (a[1] - b[1]) * (a[2] + b[2]);
      n[1] += (a[2] - b[2]) * (a[0] + b[0]);
      n[2] += (a[0] - b[0]) * (a[1] + b[1]);
    });
    return unit(n);
  }

  // the place nearest above or below at which a name does not overprint one that stands already
  function free([x, y], half, taken) {
    const line = 14;
    const clear = (at) => taken.every((t) => Math.abs(x - t.x) >= half + t.half + 4
      || Math.abs(at - t.y) >= line);
    const tried = [0, ...taken.flatMap((t) => [t.y - line - y, t.y + line - y])]
      .sort((a, b) => Math.abs(a) - Math.abs(b));
    const found = y + tried.find((step) => clear(y + step));
    taken.push({ x, y: found, half });
    return [x, found];
  }

  // a convex polygon as its middle, its normal and the inward normals of its edges
  function face(points) {
    const n = normal(points), less = (a, b) => a.map((x, i) => x - b[i]);
    const middle = [0, 1, 2].map((i) => points.reduce((sum, p) => sum + p[i], 0) / points.length);
    const edges = points.map((a, i) => {
      const e = less(points[(i + 1) % points.length], a);
      const inward = [n[1] * e[2] - n[2] * e[1], n[2] * e[0] - n[0] * e[2], n[0] * e[1] - n[1] * e[0]];
      return [inward, dot(inward, a)];
    });
    return { middle, n, height: dot(n, middle), edges };
  }

  // distance along a ray at which it meets a polygon; −Infinity if it does not, or lies behind
  function hit(polygon, from, ray) {
    const along = dot(polygon.n, ray);
    if (Math.abs(along) < 1e-9) return -Infinity;
    const length = (polygon.height - dot(polygon.n, from)) / along;
    if (length <= 0) return -Infinity;
    const at = from.map((x, i) => x + length * ray[i]);
    return polygon.edges.every(([inward, least]) => dot(inward, at) >= least - 1e-9) ? length : -Infinity;
  }

  // whether a face is between the middle of a tile and the Sun
  function inShadow(tile, blocking, sun) {
    if (dot(tile.n, sun) <= 0) return false;
    const from = tile.middle.map((x, i) => x + 2e-3 * tile.n[i]);
    return blocking.some((one) => hit(one, from, sun) > 1e-4);
  }

  // fraction of a ray from the centre at which it leaves the body
  function support(scene, view, ray) {
    if (scene.parts) {
      const faces = scene.polygons.map(({ p }) => face(p.map((q) => view.map((axis) => dot(axis, q)))));
      return Math.max(0, ...faces.map((one) => hit(one, [0, 0, 0], ray)));
    }
    let least = 1;
    for (const polygon of scene.polygons) {
      const points = polygon.p.map((p) => view.map((axis) => dot(axis, p)));
      const n = normal(points);
      const along = dot(n, ray);
      if (along > 1e-9) least = Math.min(least, dot(n, points[0]) / along);
    }
    return least;
  }

  const css = (name, other) => getComputedStyle(document.documentElement).getPropertyValue(name).trim() || other;

  // `view`: rows right, up and towards the reader; `sun`: its direction in the view, else a lamp
  function paint(canvas, scene, view, sun) {
    const pen = canvas.getContext("2d");
    const ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width || !height) return;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    const scale = Math.min(width, height) / (scene.solid ? 2.95 : 3.1);
    const turn = (p) => view.map((axis) => dot(axis, p));
    const at = (q) => [width / 2 + scale * q[0], height / 2 - scale * q[1]];

    const line = (from, to, colour, thick) => {
      pen.beginPath();
      pen.moveTo(...at(from)); pen.lineTo(...at(to));
      pen.strokeStyle = colour; pen.lineWidth = thick; pen.stroke();
    };
    // spin axis: the half that is farther away goes behind the body
    const tip = turn((scene.axis || [0, 0, 0]).map((x) => 1.25 * x)), tail = tip.map((x) => -x);
    const axis = (end) => line([0, 0, 0], end, css("--blue", "#0072B2"), end === tip ? 2.2 : 1.4);
    const ends = [tip, tail].sort((a, b) => a[2] - b[2]);
    axis(ends[0]);
    if (!scene.solid) {
      pen.beginPath();
      pen.arc(width / 2, height / 2, scale, 0, 2 * Math.PI);
      pen.fillStyle = "rgba(255,255,255,0.6)"; pen.fill();
      pen.strokeStyle = "#c3c9d1"; pen.lineWidth = 1; pen.stroke();
      axis(ends[1]);
    }
    const polygons = scene.polygons.map((polygon) => {
      const points = polygon.p.map(turn);
      return { points, colour: polygon.c, dark: polygon.dark, normal: normal(points),
               depth: points.reduce((sum, q) => sum + q[2], 0) / points.length };
    });
    polygons.sort((a, b) => a.depth - b.depth);
    for (const { points, colour, dark, normal: n } of polygons) {
      const front = n[2] > 0;
      if (scene.solid && !front) continue;
      const facing = front ? n : n.map((x) => -x);
      const dim = sun ? 0.14 : scene.solid ? 0.42 : 0.8;
      const light = scene.flat ? 1 : dim + (1 - dim) * (dark ? 0 : Math.max(0, dot(sun ? n : facing, sun || LIGHT)));
      const rgb = colour.map((c) => Math.round(255 * Math.min(1, light * c))).join(",");
      pen.beginPath();
      points.forEach((q, i) => (i ? pen.lineTo(...at(q)) : pen.moveTo(...at(q))));
      pen.closePath();
      pen.fillStyle = `rgba(${rgb},${front ? 1 : 0.35})`;
      pen.fill();
      pen.strokeStyle = scene.solid ? `rgba(${rgb},1)` : "rgba(60,60,60,0.7)";
      pen.lineWidth = scene.solid ? 0.8 : 0.7;
      pen.stroke();
    }
    if (scene.solid && scene.axis) {
      const inside = ends[1];
      // only what sticks out of the body towards the reader: hide the stretch within it
      const reach = support(scene, view, inside);
      line(inside.map((x) => x * reach), inside, css("--blue", "#0072B2"), inside === tip ? 2.2 : 1.4);
    }
    (scene.dots || []).map(turn).filter((q) => q[2] > 0).forEach((q) => {
      pen.beginPath();
      pen.arc(...at(q), 1.6, 0, 2 * Math.PI);
      pen.fillStyle = "rgba(255,255,255,0.85)"; pen.fill();
    });
    pen.font = "12px system-ui, sans-serif";
    pen.textAlign = "center"; pen.textBaseline = "middle";
    const taken = [];  // middle and half width of the names that stand already
    scene.labels.forEach((where, i) => {
      const q = turn(where), text = scene.names ? scene.names[i] : String(i);
      if (scene.names && q[2] < 0) return;
      const half = pen.measureText(text).width / 2;
      const spot = scene.names ? free(at(q), half, taken) : at(q);
      pen.lineWidth = 3; pen.strokeStyle = "rgba(255,255,255,0.85)";
      pen.strokeText(text, ...spot);
      pen.fillStyle = q[2] > 0 ? "#1c1f24" : "rgba(28,31,36,0.45)";
      pen.fillText(text, ...spot);
    });
    const mark = at(tip.map((x) => 1.08 * x));
    pen.fillStyle = css("--blue", "#0072B2");
    if (scene.axis) pen.fillText("spin", ...mark);
  }

  function viewer(figure) {
    const scene = JSON.parse(figure.querySelector("script[type='application/json']").textContent);
    const canvas = figure.querySelector("canvas");
    if (!canvas.getContext("2d")) return;
    const start = scene.view ? { lon: scene.view[0], lat: scene.view[1] } : { lon: 0.6, lat: 0.4 };
    let { lon, lat } = start;

    function basis() {
      const right = [-Math.sin(lon), Math.cos(lon), 0];
      const towards = [Math.cos(lat) * Math.cos(lon), Math.cos(lat) * Math.sin(lon), Math.sin(lat)];
      const up = [-Math.sin(lat) * Math.cos(lon), -Math.sin(lat) * Math.sin(lon), Math.cos(lat)];
      return [right, up, towards];
    }

    function draw() {
      paint(canvas, scene, basis());
    }

    function rotate(dx, dy) {
      lon -= dx;
      lat = Math.max(-1.5707, Math.min(1.5707, lat + dy));
      canvas.dataset.view = `${lon.toFixed(3)} ${lat.toFixed(3)}`;
      draw();
    }

    let last = null;
    canvas.addEventListener("pointerdown", (e) => {
      last = [e.clientX, e.clientY];
      try { canvas.setPointerCapture(e.pointerId); } catch (_) { /* a pointer that is gone */ }
    });
    canvas.addEventListener("pointermove", (e) => {
      if (!last) return;
      rotate((e.clientX - last[0]) / 120, (e.clientY - last[1]) / 120);
      last = [e.clientX, e.clientY];
    });
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, () => { last = null; });
    canvas.addEventListener("dblclick", () => { ({ lon, lat } = start); rotate(0, 0); });
    canvas.addEventListener("keydown", (e) => {
      const step = { ArrowLeft: [-0.12, 0], ArrowRight: [0.12, 0], ArrowUp: [0, 0.12], ArrowDown: [0, -0.12] }[e.key];
      if (!step) return;
      e.preventDefault();
      rotate(...step);
    });
    figure.querySelector(".viewer").hidden = false;
    new ResizeObserver(draw).observe(canvas);
    rotate(0, 0);
  }

  Object.assign(lcbayes, { paintBody: paint, unit3: unit, dot3: dot, face, inShadow });
  document.querySelectorAll("figure.shape").forEach(viewer);
})(window.lcbayes);
