// Drawing: people, cameras and the floor on a canvas, through any projection (point) => [x, y, depth] or null.

function themeColours() {
  const style = getComputedStyle(document.documentElement);
  const of = (name) => style.getPropertyValue(name).trim();
  return { page: of("--page"), panel: of("--panel"), ink: of("--ink"), soft: of("--soft"), grid: of("--grid"), red: of("--red"), line: of("--line"), strong: of("--strong") };
}

// Match the canvas to its place on the page and its screen; return its context in CSS pixels, wiped.
function cleared(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

function stroke(context, points, colour, width, dash = []) {
  context.beginPath();
  points.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.setLineDash(dash);
  context.stroke();
  context.setLineDash([]);
}

function dot(context, [x, y], radius, colour, outline) {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.fillStyle = colour;
  context.fill();
  if (outline) { context.strokeStyle = outline; context.lineWidth = 1; context.stroke(); }
}

// Completed joints: a diamond in the colour of the person, outlined in red.
function diamond(context, [x, y], radius, colour, red) {
  context.beginPath();
  context.moveTo(x, y - radius);
  context.lineTo(x + radius, y);
  context.lineTo(x, y + radius);
  context.lineTo(x - radius, y);
  context.closePath();
  context.fillStyle = colour;
  context.fill();
  context.strokeStyle = red;
  context.lineWidth = 2;
  context.stroke();
}

// The outline of the region that holds 90 %, as the projection sees it.
function drawRegion(context, project, point, spread, at, colour) {
  let xx = 0, xy = 0, yy = 0;
  for (const column of spread) {
    const end = project(point.map((value, axis) => value + column[axis]));
    if (!end) return;
    const dx = end[0] - at[0], dy = end[1] - at[1];
    xx += dx * dx;
    xy += dx * dy;
    yy += dy * dy;
  }
  const mean = (xx + yy) / 2, difference = Math.hypot((xx - yy) / 2, xy);
  const major = Z90 * Math.sqrt(mean + difference), minor = Z90 * Math.sqrt(Math.max(0, mean - difference));
  if (!(major < 4000)) return;
  context.beginPath();
  context.ellipse(at[0], at[1], Math.max(major, 0.5), Math.max(minor, 0.5), Math.atan2(2 * xy, xx - yy) / 2, 0, 2 * Math.PI);
  context.fillStyle = colour;
  context.globalAlpha = 0.13;
  context.fill();
  context.globalAlpha = 0.6;
  context.strokeStyle = colour;
  context.lineWidth = 1;
  context.stroke();
  context.globalAlpha = 1;
}

// Truth is a thin line without joints.
function drawTruth(context, project, truth, frame, colour) {
  context.globalAlpha = 0.75;
  for (let person = 0; person < truth.persons; person++) {
    for (const [parent, child] of truth.bones) {
      const ends = [parent, child].map((joint) => truth.point(frame, person, joint)).map((point) => point && project(point));
      if (ends[0] && ends[1]) stroke(context, ends, colour, 1.25);
    }
  }
  context.globalAlpha = 1;
}

// People from far to near: bones in the colour of the person, dashed where an end is completed.
function drawPeople(context, project, clip, frame, shown, colours) {
  const items = [];
  const poses = clip.poses;
  for (let person = 0; person < poses.persons; person++) {
    const colour = clip.colours[person % clip.colours.length];
    const joints = poses.joints.map((_, joint) => {
      const source = poses.source(frame, person, joint);
      if (!source || !(source === COMPLETED ? shown.completed : shown.measured)) return null;
      const point = poses.point(frame, person, joint);
      const at = project(point);
      return at && { at, point, completed: source === COMPLETED, spread: shown.uncertainty && poses.spread(frame, person, joint) };
    });
    for (const [parent, child] of poses.bones) {
      const [a, b] = [joints[parent], joints[child]];
      if (!a || !b) continue;
      const dash = a.completed || b.completed ? [5, 4] : [];
      items.push({ depth: (a.at[2] + b.at[2]) / 2, draw: () => stroke(context, [a.at, b.at], colour, 3, dash) });
    }
    for (const joint of joints.filter(Boolean)) {
      items.push({
        depth: joint.at[2] - 0.02,
        draw: () => {
          if (joint.spread) drawRegion(context, project, joint.point, joint.spread, joint.at, joint.completed ? colours.red : colour);
          if (joint.completed) diamond(context, joint.at, 4.5, colour, colours.red);
          else dot(context, joint.at, 3, colour);
        },
      });
    }
  }
  context.lineCap = "round";
  items.sort((a, b) => b.depth - a.depth).forEach((item) => item.draw());
}

function drawNames(context, project, clip, frame, colours) {
  context.font = "600 12px system-ui, sans-serif";
  context.textAlign = "center";
  for (let person = 0; person < clip.poses.persons; person++) {
    let top = null;
    clip.poses.joints.forEach((_, joint) => {
      const point = clip.poses.point(frame, person, joint);
      if (point && (!top || point[2] > top[2])) top = point;
    });
    const at = top && project([top[0], top[1], top[2] + 0.18]);
    if (!at) continue;
    context.lineWidth = 3;
    context.strokeStyle = colours.page;
    context.strokeText(`P${person + 1}`, at[0], at[1]);
    context.fillStyle = clip.colours[person % clip.colours.length];
    context.fillText(`P${person + 1}`, at[0], at[1]);
  }
}

// A floor of metres at z = 0, under what moves, with a soft shadow of each bone.
function drawFloor(context, project, extent, colours) {
  const [x0, x1, y0, y1] = extent;
  for (let x = x0; x <= x1; x++) floorLine(context, project, [x, y0], [x, y1], colours.grid);
  for (let y = y0; y <= y1; y++) floorLine(context, project, [x0, y], [x1, y], colours.grid);
}

function floorLine(context, project, from, to, colour) {
  const steps = 24;
  let before = null;
  context.globalAlpha = 0.7;
  for (let i = 0; i <= steps; i++) {
    const at = project([from[0] + ((to[0] - from[0]) * i) / steps, from[1] + ((to[1] - from[1]) * i) / steps, 0]);
    if (before && at) stroke(context, [before, at], colour, 1);
    before = at;
  }
  context.globalAlpha = 1;
}

function drawShadows(context, project, poses, frame, colours) {
  context.globalAlpha = 0.14;
  for (let person = 0; person < poses.persons; person++) {
    for (const [parent, child] of poses.bones) {
      const ends = [parent, child].map((joint) => poses.point(frame, person, joint)).map((point) => point && project([point[0], point[1], 0]));
      if (ends[0] && ends[1]) stroke(context, ends, colours.ink, 4);
    }
  }
  context.globalAlpha = 1;
}

function drawCameras(context, project, cameras, chosen, size, colours) {
  context.font = "11px system-ui, sans-serif";
  context.textAlign = "center";
  cameras.forEach((camera, number) => {
    const centre = cameraCentre(camera), { R, K } = camera;
    const reach = size / Math.max(camera.size[0] / K[0], camera.size[1] / K[3]);
    const corner = (u, v) => {
      const ray = [((u - K[2]) / K[0]) * reach, ((v - K[4]) / K[3]) * reach, reach];
      return project([0, 1, 2].map((i) => centre[i] + R[i] * ray[0] + R[3 + i] * ray[1] + R[6 + i] * ray[2]));
    };
    const [w, h] = camera.size;
    const corners = [corner(0, 0), corner(w, 0), corner(w, h), corner(0, h)];
    const tip = project(centre);
    if (!tip || corners.some((at) => !at)) return;
    const colour = number === chosen ? colours.ink : colours.strong, width = number === chosen ? 1.75 : 1;
    stroke(context, [...corners, corners[0]], colour, width);
    for (const at of corners) stroke(context, [tip, at], colour, width);
    context.fillStyle = colour;
    context.fillText(camera.name, tip[0], tip[1] - 8);
  });
}

// Detections: hollow circles and thin lines, dark under light, to be seen on any image.
function drawDetections(context, scale, clip, frame, view) {
  const { detections } = clip;
  for (let detection = 0; detection < detections.number; detection++) {
    const points = detections.joints.map((_, joint) => {
      const point = detections.point(frame, view, detection, joint);
      return point && scale(point);
    });
    for (const [colour, width] of [["rgba(0,0,0,0.55)", 2.6], ["rgba(255,255,255,0.95)", 1.1]]) {
      for (const [parent, child] of detections.bones) {
        if (points[parent] && points[child]) stroke(context, [points[parent], points[child]], colour, width);
      }
      for (const point of points) {
        if (!point) continue;
        context.beginPath();
        context.arc(point[0], point[1], 3.2, 0, 2 * Math.PI);
        context.strokeStyle = colour;
        context.lineWidth = width;
        context.stroke();
      }
    }
  }
}

// The clip in time: completed and missing joints from below, the error as a line, gaps to jump to.
function drawStrip(canvas, clip) {
  const { context, width, height } = cleared(canvas);
  const colours = themeColours();
  const { completed, missing } = clip.gaps;
  const frames = clip.frames;
  context.fillStyle = colours.page;
  context.fillRect(0, 0, width, height);
  const across = (frame) => (frames > 1 ? 1 + ((width - 2) * frame) / (frames - 1) : width / 2);
  const half = width / Math.max(frames, 1) / 2;
  const area = (lower, upper, colour, alpha) => {
    context.beginPath();
    for (let frame = 0; frame < upper.length; frame++) {
      for (const x of [across(frame) - half, across(frame) + half]) context.lineTo(x, height * (1 - lower(frame) - upper[frame]));
    }
    for (let frame = upper.length - 1; frame >= 0; frame--) {
      for (const x of [across(frame) + half, across(frame) - half]) context.lineTo(x, height * (1 - lower(frame)));
    }
    context.fillStyle = colour;
    context.globalAlpha = alpha;
    context.fill();
  };
  area(() => 0, completed, colours.red, 0.55);
  area((frame) => completed[frame], missing, colours.soft, 0.4);
  context.globalAlpha = 1;
  const known = (clip.error || []).filter((error) => error !== null);
  const most = Math.max(...known, 0);
  if (most > 0) {
    let line = [];
    clip.error.forEach((error, frame) => {
      if (error !== null) line.push([across(frame), height - 3 - ((height - 8) * error) / most]);
      if ((error === null || frame === frames - 1) && line.length) {
        stroke(context, line, colours.ink, 1.25);
        line = [];
      }
    });
  }
  context.strokeStyle = colours.line;
  context.lineWidth = 1;
  context.strokeRect(0.5, 0.5, width - 1, height - 1);
}
