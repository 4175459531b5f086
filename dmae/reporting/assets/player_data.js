// The clips of the player: arrays unpacked, points projected as OpenCV does.

const ABSENT = -32768;  // an integer that is not known
const MEASURED = 1, COMPLETED = 3;
const Z90 = 2.5003;  // standard deviations in three dimensions that hold 90 %

async function inflated(base64) {
  const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// The inverse of Python's `packed`: frames outermost again.
async function unpacked(base64, frames) {
  const bytes = await inflated(base64);
  const total = bytes.length / 3, series = frames ? total / frames : 0;
  const values = new Int16Array(total);
  for (let s = 0; s < series; s++) {
    let value = 0;
    for (let f = 0; f < frames; f++) {
      const i = s * frames + f;
      value = (value + bytes[i] + (bytes[total + i] << 8)) & 0xffff;
      values[f * series + s] = bytes[2 * total + i] ? value : ABSENT;
    }
  }
  return values;
}

async function unpackedPoses(poses, frames) {
  if (!poses) return null;
  const count = poses.joints.length;
  const xyz = await unpacked(poses.xyz, frames);
  const source = poses.source ? await unpacked(poses.source, frames) : null;
  const spread = poses.spread ? await unpacked(poses.spread, frames) : null;
  const index = (frame, person, joint) => (frame * poses.persons + person) * count + joint;
  return {
    joints: poses.joints, bones: poses.bones, persons: poses.persons,
    point(frame, person, joint) {
      const i = 3 * index(frame, person, joint);
      if (xyz[i] === ABSENT) return null;
      return [0, 1, 2].map((axis) => poses.origin[axis] + poses.unit * xyz[i + axis]);
    },
    source(frame, person, joint) {
      const i = index(frame, person, joint);
      if (source) return source[i];
      return xyz[3 * i] === ABSENT ? 0 : MEASURED;
    },
    // The three columns of the root of the covariance, m; null where it is not stated.
    spread(frame, person, joint) {
      if (!spread) return null;
      const i = 6 * index(frame, person, joint);
      if (spread[i] === ABSENT) return null;
      const [a, b, c, d, e, f] = [0, 1, 2, 3, 4, 5].map((k) => poses.spreadUnit * spread[i + k]);
      return [[a, b, c], [b, d, e], [c, e, f]];
    },
    present(frame, person) {
      for (let joint = 0; joint < count; joint++) if (this.source(frame, person, joint)) return true;
      return false;
    },
    centre(frame, person) {
      const sum = [0, 0, 0];
      let known = 0;
      for (let joint = 0; joint < count; joint++) {
        const point = this.point(frame, person, joint);
        if (point) { known++; for (let axis = 0; axis < 3; axis++) sum[axis] += point[axis]; }
      }
      return known ? sum.map((value) => value / known) : null;
    },
  };
}

async function unpackedClip(data) {
  const detected = await unpacked(data.detections.xy, data.frames);
  const joints = data.detections.joints.length, views = data.cameras.length;
  const poses = await unpackedPoses(data.poses, data.frames);
  return {
    ...data,
    poses,
    truth: await unpackedPoses(data.truth, data.frames),
    detections: {
      ...data.detections,
      point(frame, view, detection, joint) {
        const i = 2 * (((frame * views + view) * data.detections.number + detection) * joints + joint);
        return detected[i] === ABSENT ? null : [data.detections.unit * detected[i], data.detections.unit * detected[i + 1]];
      },
    },
    gaps: poses ? gapsOf(poses, data.frames) : { starts: [], completed: [], missing: [] },
  };
}

// Shares of the joints of present people that are completed and missing, by frame; and where gaps begin.
function gapsOf(poses, frames) {
  const completed = new Float32Array(frames), missing = new Float32Array(frames), starts = [];
  const measuredBefore = new Map();
  for (let frame = 0; frame < frames; frame++) {
    let all = 0;
    for (let person = 0; person < poses.persons; person++) {
      const present = poses.present(frame, person);
      const began = [];
      for (let joint = 0; joint < poses.joints.length; joint++) {
        const source = poses.source(frame, person, joint), key = person * 1000 + joint;
        const measured = source !== 0 && source !== COMPLETED;
        if (present) {
          all++;
          if (source === COMPLETED) completed[frame]++;
          if (source === 0) missing[frame]++;
          if (!measured && measuredBefore.get(key) !== false) began.push(joint);
        }
        measuredBefore.set(key, present ? measured : true);
      }
      if (began.length) starts.push({ frame, person, joints: began });
    }
    if (all) { completed[frame] /= all; missing[frame] /= all; }
  }
  return { starts, completed, missing };
}

// Pixel and depth of a point of the world in a camera; null behind it or beyond its lens.
function projected(camera, point) {
  const { R, t, K, dist } = camera;
  const inCamera = [0, 1, 2].map((i) => R[3 * i] * point[0] + R[3 * i + 1] * point[1] + R[3 * i + 2] * point[2] + t[i]);
  const depth = inCamera[2];
  if (depth <= 0) return null;
  let x = inCamera[0] / depth, y = inCamera[1] / depth;
  const square = x * x + y * y, radius = Math.sqrt(square);
  if (camera.reach !== null && radius >= camera.reach) return null;
  if (camera.fisheye) {
    const angle = Math.atan(radius), a = angle * angle;
    const bent = angle * (1 + a * (dist[0] + a * (dist[1] + a * (dist[2] + a * dist[3]))));
    const scale = radius > 1e-8 ? bent / radius : 1;
    x *= scale;
    y *= scale;
  } else {
    const [k1, k2, p1, p2, k3, k4, k5, k6] = dist;
    const radial = (1 + square * (k1 + square * (k2 + square * k3))) / (1 + square * (k4 + square * (k5 + square * k6)));
    [x, y] = [x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x), y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y];
  }
  return [K[0] * x + K[1] * y + K[2], K[3] * y + K[4], depth];
}

function cameraCentre(camera) {
  return [0, 1, 2].map((i) => -(camera.R[i] * camera.t[0] + camera.R[3 + i] * camera.t[1] + camera.R[6 + i] * camera.t[2]));
}
