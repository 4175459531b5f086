// The player: one clip at a time, its motion in 3D and one camera's image in step.

async function player() {
  const packedClips = JSON.parse(byId("clips").textContent);
  const box = byId("player");
  const toggles = { truth: true, measured: true, completed: true, uncertainty: false, cameras: true, detections: true, image: true };
  const orbit = { yaw: -0.9, pitch: 0.38, distance: 8, target: [0, 0, 1] };
  const video = byId("image"), world = byId("world"), view = byId("view");
  let clip = null, frame = 0, camera = 0, followed = null, playing = false, clock = 0, drawn = false;

  // Choices and toggles

  const option = (text, value) => Object.assign(document.createElement("option"), { textContent: text, value });
  byId("clip").append(...packedClips.map((data, i) => option(data.id, i)));
  byId("clip-field").hidden = packedClips.length < 2;
  const toggleTitles = { measured: "measured", completed: "completed", truth: "truth", uncertainty: "uncertainty (90 %)", detections: "detections", cameras: "cameras", image: "image" };
  for (const [name, title] of Object.entries(toggleTitles)) {
    const label = document.createElement("label");
    const input = Object.assign(document.createElement("input"), { type: "checkbox", checked: toggles[name], id: `show-${name}` });
    input.addEventListener("change", () => { toggles[name] = input.checked; draw(); });
    label.append(input, title);
    byId("toggles").append(label);
  }

  function say(notes) {
    byId("notes").textContent = notes.join(" ");
    byId("notes").hidden = !notes.length;
  }

  async function open(number) {
    pause();
    const data = packedClips[number];
    clip = await unpackedClip(data);
    byId("clip").value = number;
    byId("camera").replaceChildren(...clip.cameras.map((each, i) => option(each.name, i)));
    const people = clip.poses ? clip.poses.persons : 0;
    byId("follow").replaceChildren(option("no one", ""), ...Array.from({ length: people }, (_, i) => option(`P${i + 1}`, i)));
    byId("frame").max = Math.max(0, clip.frames - 1);
    const has = { truth: clip.truth, measured: clip.poses, completed: clip.poses, uncertainty: clip.poses, image: clip.cameras.some((each) => each.video) };
    for (const name of Object.keys(toggleTitles)) byId(`show-${name}`).parentElement.hidden = name in has && !has[name];
    byId("gap").disabled = !clip.gaps.starts.length;
    byId("worst").disabled = worst() === null;
    for (const id of ["play", "back", "forward", "frame"]) byId(id).disabled = clip.frames < 2;
    say(clip.notes);
    followed = null;
    frame = 0;
    chooseCamera(mostDetections());
    lookAtAll();
    legend();
    drawStrip(byId("strip"), clip);
    seek(0);
  }

  function chooseCamera(number) {
    const resume = playing;
    pause();
    camera = number;
    byId("camera").value = number;
    const { size, video: base64 } = clip.cameras[camera] || { size: [4, 3] };
    view.parentElement.style.aspectRatio = `${size[0]} / ${size[1]}`;
    world.parentElement.style.aspectRatio = `${size[0]} / ${size[1]}`;
    if (video.src) URL.revokeObjectURL(video.src);
    video.removeAttribute("src");
    delete video.dataset.frame;
    if (base64) {
      const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
      video.src = URL.createObjectURL(new Blob([bytes], { type: "video/mp4" }));
    }
    video.hidden = !base64;
    seek(frame);
    if (resume) play();
  }

  // The camera that detects most joints is the first to be shown.
  function mostDetections() {
    const { detections } = clip;
    const counts = clip.cameras.map(() => 0);
    const step = Math.max(1, Math.floor(clip.frames / 40));
    for (let f = 0; f < clip.frames; f += step) {
      counts.forEach((_, number) => {
        for (let d = 0; d < detections.number; d++) {
          for (let joint = 0; joint < detections.joints.length; joint++) counts[number] += detections.point(f, number, d, joint) ? 1 : 0;
        }
      });
    }
    return counts.indexOf(Math.max(...counts));
  }

  // Time. With an image, the video is the clock and every drawing is of the frame that it shows.

  const hasVideo = () => Boolean(video.src) && !video.error;
  const speed = () => Number(byId("speed").value);

  function seek(to) {
    frame = Math.min(Math.max(0, to), Math.max(0, clip.frames - 1));
    clock = frame;
    if (hasVideo() && !playing) video.currentTime = (frame + 0.5) / clip.fps;
    draw();
  }

  function jump(to) {
    pause();
    seek(to);
  }

  function play() {
    if (clip.frames < 2) return;
    if (frame >= clip.frames - 1) seek(0);
    playing = true;
    byId("play").textContent = "Pause";
    if (hasVideo()) {
      video.playbackRate = speed();
      video.play().catch(pause);
    }
    let before = performance.now();
    const tick = (now) => {
      if (!playing) return;
      if (hasVideo()) {
        if (!video.requestVideoFrameCallback) shown(video.currentTime - 0.5 / clip.fps);
      } else {
        clock += ((now - before) / 1000) * clip.fps * speed();
        const to = Math.floor(clock);
        if (to >= clip.frames - 1) { frame = clip.frames - 1; pause(); draw(); return; }
        if (to !== frame) { frame = to; draw(); }
      }
      before = now;
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  function pause() {
    if (!playing) return;
    playing = false;
    byId("play").textContent = "Play";
    video.pause();
    if (hasVideo()) seek(frame);
  }

  // The video presents a new image, of this time in seconds.
  function shown(seconds) {
    const number = Math.min(clip.frames - 1, Math.max(0, Math.round(seconds * clip.fps)));
    video.dataset.frame = number;
    if (playing) { frame = number; clock = number; }
    draw();
  }

  if (video.requestVideoFrameCallback) {
    const presented = (_, about) => {
      if (hasVideo()) shown(about.mediaTime);
      video.requestVideoFrameCallback(presented);
    };
    video.requestVideoFrameCallback(presented);
    // A browser may not call back for a video that is out of sight.
    const settle = () => {
      if (hasVideo() && !playing && !video.seeking && Number(video.dataset.frame) !== frame) shown(video.currentTime - 0.5 / clip.fps);
    };
    video.addEventListener("seeked", () => setTimeout(settle, 200));
  } else {
    video.addEventListener("seeked", () => shown(video.currentTime - 0.5 / clip.fps));
  }
  for (const name of ["seeked", "loadeddata"]) video.addEventListener(name, () => draw());
  video.addEventListener("ended", () => { if (playing) { frame = clip.frames - 1; pause(); draw(); } });
  video.addEventListener("error", () => {
    if (!clip || !video.src) return;
    say([...clip.notes, "This browser cannot play the images, which are H.264 video."]);
    draw();
  });

  // Gaps and the worst frame

  function worst() {
    const score = clip.error ? clip.error : Array.from(clip.gaps.completed, (share, i) => share + clip.gaps.missing[i]);
    let best = null;
    score.forEach((value, i) => { if (value !== null && value > 0 && (best === null || value > score[best])) best = i; });
    return best;
  }

  function nextGap() {
    const starts = clip.gaps.starts.filter((start) => followed === null || start.person === followed);
    const next = starts.find((start) => start.frame > frame) || starts[0];
    if (next) jump(next.frame);
  }

  function jumpToWorst() {
    const best = worst();
    if (best !== null) jump(best);
  }

  // The viewer of the 3D view

  function lookAtAll() {
    const low = [Infinity, Infinity], high = [-Infinity, -Infinity];
    const people = clip.poses && clip.poses.persons ? clip.poses : clip.truth;
    const step = Math.max(1, Math.floor(clip.frames / 60));
    for (let f = 0; people && f < clip.frames; f += step) {
      for (let person = 0; person < people.persons; person++) {
        const centre = people.centre(f, person);
        if (!centre) continue;
        for (const axis of [0, 1]) {
          low[axis] = Math.min(low[axis], centre[axis]);
          high[axis] = Math.max(high[axis], centre[axis]);
        }
      }
    }
    const centres = clip.cameras.map(cameraCentre);
    if (!(high[0] >= low[0])) {
      for (const axis of [0, 1]) {
        low[axis] = Math.min(...centres.map((centre) => centre[axis]), 0);
        high[axis] = Math.max(...centres.map((centre) => centre[axis]), 0);
      }
    }
    const reach = Math.max(high[0] - low[0], high[1] - low[1], 1);
    orbit.target = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, 0.9];
    orbit.distance = Math.min(40, 2.6 + 1.15 * reach);
    orbit.extent = [Math.floor(low[0] - 2), Math.ceil(high[0] + 2), Math.floor(low[1] - 2), Math.ceil(high[1] + 2)];
    if (orbit.extent[1] - orbit.extent[0] > 60 || orbit.extent[3] - orbit.extent[2] > 60) orbit.extent = [-30, 30, -30, 30];
  }

  function viewer(width, height) {
    const { yaw, pitch, distance, target } = orbit;
    const [cy, sy, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
    const focal = 1.15 * Math.min(width, height * 1.2);
    return ([px, py, pz]) => {
      const [x, y, z] = [px - target[0], py - target[1], pz - target[2]];
      const right = -sy * x + cy * y, out = cy * x + sy * y;
      const depth = distance - cp * out - sp * z;
      if (depth < 0.1) return null;
      const up = cp * z - sp * out;
      return [width / 2 + (focal * right) / depth, height / 2 - (focal * up) / depth, depth];
    };
  }

  const zoom = (factor) => { orbit.distance = Math.min(80, Math.max(1, orbit.distance * factor)); draw(); };
  const pointers = new Map();
  world.addEventListener("pointerdown", (event) => {
    world.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
  });
  world.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const [dx, dy] = [event.clientX - before[0], event.clientY - before[1]];
    const spread = () => { const [a, b] = [...pointers.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
    const apart = pointers.size === 2 ? spread() : 0;
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    if (pointers.size === 2) {
      if (apart > 0) zoom(apart / Math.max(1, spread()));
      move(dx / 2, dy / 2);
    } else if (event.shiftKey || event.buttons === 2) {
      move(dx, dy);
    } else {
      orbit.yaw -= dx * 0.008;
      orbit.pitch = Math.min(1.5, Math.max(-0.2, orbit.pitch + dy * 0.008));
    }
    draw();
  });
  for (const name of ["pointerup", "pointercancel"]) world.addEventListener(name, (event) => pointers.delete(event.pointerId));
  world.addEventListener("contextmenu", (event) => event.preventDefault());
  world.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && !event.metaKey && document.activeElement !== world) return;
    event.preventDefault();
    zoom(Math.exp(event.deltaY * 0.0015));
  }, { passive: false });

  function move(dx, dy) {
    const metres = orbit.distance / (1.15 * world.clientHeight);
    orbit.target[0] += Math.sin(orbit.yaw) * dx * metres;
    orbit.target[1] -= Math.cos(orbit.yaw) * dx * metres;
    orbit.target[2] += dy * metres;
  }

  // Drawing, at most once for each refresh of the screen

  function draw() {
    if (drawn) return;
    drawn = true;
    requestAnimationFrame(() => { drawn = false; drawNow(); });
  }

  function drawNow() {
    if (!clip) return;
    const colours = themeColours();
    drawWorld(colours);
    drawView(colours);
    byId("frame").value = frame;
    const number = clip.first + frame;
    byId("frame").setAttribute("aria-valuetext", `frame ${number}`);
    byId("time").textContent = clip.frames
      ? `frame ${number} of ${clip.first}–${clip.first + clip.frames - 1} · ${(number / clip.fps).toFixed(2)} s` : "no frames";
    byId("status").textContent = statusLine();
    box.dataset.frame = frame;
    box.dataset.playing = playing;
  }

  function drawWorld(colours) {
    const { context, width, height } = cleared(world);
    if (followed !== null && clip.poses && clip.frames) {
      const centre = clip.poses.centre(frame, followed);
      const step = playing ? 0.2 : 1;  // smoothly while playing
      if (centre) orbit.target = centre.map((value, axis) => orbit.target[axis] + step * (value - orbit.target[axis]));
    }
    const project = viewer(width, height);
    drawFloor(context, project, orbit.extent, colours);
    if (toggles.cameras) drawCameras(context, project, clip.cameras, camera, 0.35, colours);
    if (!clip.frames) return;
    if (clip.poses) drawShadows(context, project, clip.poses, frame, colours);
    if (clip.truth && toggles.truth) drawTruth(context, project, clip.truth, frame, colours.ink);
    if (clip.poses) {
      drawPeople(context, project, clip, frame, toggles, colours);
      drawNames(context, project, clip, frame, colours);
    }
  }

  function drawView(colours) {
    const waiting = hasVideo() && toggles.image && (video.seeking || video.readyState < 2);
    if (waiting && "frame" in video.dataset) return;  // what is drawn stays until the next image is there
    const { context, width, height } = cleared(view);
    if (!clip.frames || !clip.cameras.length) return;
    const chosen = clip.cameras[camera];
    const factor = Math.min(width / chosen.size[0], height / chosen.size[1]);
    const left = (width - factor * chosen.size[0]) / 2, top = (height - factor * chosen.size[1]) / 2;
    const scale = ([x, y]) => [left + factor * (x + 0.5), top + factor * (y + 0.5)];  // pixel (0, 0) is a centre
    const project = (point) => { const at = projected(chosen, point); return at && [...scale(at), at[2]]; };
    const ready = hasVideo() && video.readyState >= 2;
    const now = ready && "frame" in video.dataset ? Number(video.dataset.frame) : frame;
    if (toggles.image && ready) context.drawImage(video, left, top, factor * chosen.size[0], factor * chosen.size[1]);
    else { context.fillStyle = colours.panel; context.fillRect(0, 0, width, height); }
    const onImage = toggles.image && ready;
    if (toggles.detections) drawDetections(context, scale, clip, now, camera);
    if (clip.truth && toggles.truth) drawTruth(context, project, clip.truth, now, onImage ? "#ffffff" : colours.ink);
    if (clip.poses) {
      drawPeople(context, project, clip, now, toggles, colours);
      drawNames(context, project, clip, now, colours);
    }
    view.dataset.frame = now;
  }

  function statusLine() {
    if (!clip.poses || !clip.frames) return "";
    const parts = [];
    for (let person = 0; person < clip.poses.persons; person++) {
      if (followed !== null && person !== followed) continue;
      if (!clip.poses.present(frame, person)) continue;
      const names = (wanted) => clip.poses.joints.filter((_, joint) => clip.poses.source(frame, person, joint) === wanted);
      const completed = names(COMPLETED), missing = names(0);
      const list = (found) => (found.length > 4 ? `${found.length} joints` : found.join(", "));
      if (completed.length) parts.push(`P${person + 1}: completed ${list(completed)}`);
      if (missing.length) parts.push(`P${person + 1}: missing ${list(missing)}`);
    }
    const error = clip.error && clip.error[frame];
    if (error !== null && error !== undefined && error !== false) parts.unshift(`mean error ${Math.round(error)} mm`);
    return parts.join(" · ") || "every joint measured";
  }

  function legend() {
    const place = byId("legend");
    place.replaceChildren();
    const shape = (markup, text) => {
      const span = document.createElement("span");
      span.innerHTML = `<svg viewBox="0 0 16 16" aria-hidden="true">${markup}</svg>`;  // markup is this script's own
      span.append(text);
      place.append(span);
    };
    const own = clip.colours[0];
    if (clip.poses) {
      for (let person = 0; person < Math.min(clip.poses.persons, 12); person++) {
        shape(`<circle cx="8" cy="8" r="5" fill="${colourOf(person)}"/>`, `P${person + 1}`);
      }
      shape(`<path d="M8 2 14 8 8 14 2 8z" fill="${own}" stroke="var(--red)" stroke-width="2.2"/>`, "completed: fewer than two cameras agree, or rejected");
    }
    if (clip.truth) shape('<path d="M1 8H15" stroke="currentColor" stroke-width="1.4"/>', "truth");
    shape('<circle cx="8" cy="8" r="4" fill="none" stroke="currentColor" stroke-width="1.3"/>', "detected");
    if (clip.gaps.completed.some((share) => share > 0)) shape('<rect y="3" width="16" height="11" fill="var(--red)" opacity=".55"/>', "share of joints completed");
    if (clip.gaps.missing.some((share) => share > 0)) shape('<rect y="3" width="16" height="11" fill="var(--soft)" opacity=".4"/>', "share of joints missing");
    if (clip.error) shape('<path d="M1 12 5 5 10 9 15 3" fill="none" stroke="currentColor" stroke-width="1.3"/>', "mean error, up to the largest");
  }

  function colourOf(person) {
    const colour = clip.colours[person % clip.colours.length];
    return /^#[0-9a-f]{6}$/i.test(colour) ? colour : "#888888";
  }

  // Controls

  const follow = (person) => { followed = person; byId("follow").value = person === null ? "" : person; draw(); };
  byId("clip").addEventListener("change", (event) => open(Number(event.target.value)));
  byId("camera").addEventListener("change", (event) => chooseCamera(Number(event.target.value)));
  byId("follow").addEventListener("change", (event) => follow(event.target.value === "" ? null : Number(event.target.value)));
  byId("speed").addEventListener("change", () => { video.playbackRate = speed(); });
  byId("play").addEventListener("click", () => (playing ? pause() : play()));
  byId("back").addEventListener("click", () => jump(frame - 1));
  byId("forward").addEventListener("click", () => jump(frame + 1));
  byId("gap").addEventListener("click", nextGap);
  byId("worst").addEventListener("click", jumpToWorst);
  byId("frame").addEventListener("input", (event) => jump(Number(event.target.value)));
  byId("closer").addEventListener("click", () => zoom(0.8));
  byId("farther").addEventListener("click", () => zoom(1.25));

  // Keys that no element has the focus for are the player's while most of it is in sight, else they scroll the page.
  function inSight() {
    const { top, bottom } = byId("world").getBoundingClientRect();
    return bottom > 0 && top < innerHeight;
  }

  const keys = {
    " ": () => (playing ? pause() : play()),
    ArrowLeft: (shift) => jump(frame - (shift ? Math.round(clip.fps) : 1)),
    ArrowRight: (shift) => jump(frame + (shift ? Math.round(clip.fps) : 1)),
    Home: () => jump(0),
    End: () => jump(clip.frames - 1),
    n: nextGap,
    w: jumpToWorst,
    c: () => chooseCamera((camera + 1) % clip.cameras.length),
    f: () => {
      const people = clip.poses ? clip.poses.persons : 0;
      follow(followed === null ? (people ? 0 : null) : followed + 1 < people ? followed + 1 : null);
    },
    "+": () => zoom(0.8),
    "=": () => zoom(0.8),
    "-": () => zoom(1.25),
  };
  document.addEventListener("keydown", (event) => {
    const at = event.target;
    const elsewhere = at === document.body ? !inSight() : !box.contains(at);
    const typed = at.matches("select, input[type=checkbox], summary") || (event.key === " " && at.matches("button"));
    if (!clip || elsewhere || typed || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.shiftKey && event.key === " ") return;  // scrolls back
    const action = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action) return;
    event.preventDefault();
    action(event.shiftKey);
  });

  for (const button of document.querySelectorAll(".moment")) {
    const number = packedClips.findIndex((data) => data.id === button.dataset.clip);
    button.addEventListener("click", async () => {
      if (clip !== null && packedClips[number].id !== clip.id) await open(number);
      jump(Number(button.dataset.frame) - clip.first);
      follow(button.dataset.person === "" ? null : Number(button.dataset.person));
      const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;
      box.scrollIntoView({ behavior: calm ? "auto" : "smooth", block: "start" });
      world.focus({ preventScroll: true });
    });
  }

  const redraw = () => { if (clip) { drawStrip(byId("strip"), clip); draw(); } };
  document.addEventListener("themechange", redraw);
  addEventListener("resize", redraw);
  box.hidden = false;
  await open(0);
}

player().catch((error) => {
  const note = Object.assign(document.createElement("p"), { className: "notes" });
  note.textContent = `This browser cannot open the player (${error.message}); all tables and figures are below.`;
  byId("player").replaceWith(note);
});
