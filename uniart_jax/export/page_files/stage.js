// The picture: camera, light, what is shown, and the mouse.

const GHOST = 0.12; // opacity of the parts behind their collision shapes
const DRAG_FROM = 12; // pixels per span below which a joint cannot be dragged: it moves towards the eye

function makeStage(canvas, tip, model, asset, onMove) {
  const renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
  renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
  renderer.shadowMap.enabled = true;
  const scene = new THREE.Scene();
  const camera = new THREE.PerspectiveCamera(asset.view.fov, 1, 0.01, 100);
  camera.up.set(0, 0, 1);

  const corners = model.reach();
  const box = new THREE.Box3().setFromPoints(corners);
  const center = box.getCenter(new THREE.Vector3());
  const ball = box.getBoundingSphere(new THREE.Sphere());
  const size = ball.radius * 2;
  scene.add(model.root, camera);

  const sky = new THREE.HemisphereLight(0xffffff, 0xb9b4ac, 1.7);
  sky.position.set(0, 0, 1);
  const key = new THREE.DirectionalLight(0xfff6ea, 2.1);
  key.target.position.copy(center);
  key.position.copy(center).add(new THREE.Vector3(-0.75, -0.45, 1.5).multiplyScalar(size));
  key.castShadow = true;
  key.shadow.mapSize.set(2048, 2048);
  key.shadow.radius = 5;
  key.shadow.normalBias = size * 0.004;
  key.shadow.bias = -0.0004;
  Object.assign(key.shadow.camera, {
    left: -size, right: size, top: size, bottom: -size, near: size * 0.1, far: size * 4,
  });
  const fill = new THREE.DirectionalLight(0xeaf1ff, 0.55);
  fill.position.set(0.6, 0.2, 1);
  camera.add(fill, fill.target);
  fill.target.position.set(0, 0, -1);
  scene.add(sky, key, key.target);

  const floor = box.min.z - size * 0.0005;
  const shade = new THREE.Mesh(
    new THREE.PlaneGeometry(size * 8, size * 8), new THREE.ShadowMaterial({ depthWrite: false }));
  shade.position.set(center.x, center.y, floor);
  shade.receiveShadow = true;
  const grid = floorGrid(center, floor, size);
  scene.add(shade, grid.lines);

  for (const part of model.parts) {
    part.ink = new THREE.Color(part.color).lerp(new THREE.Color(0x14161a), 0.28);
    part.flat = new THREE.MeshStandardMaterial({ color: part.color, roughness: 0.75 });
    for (const mesh of part.meshes) {
      mesh.userData.part = part;
      mesh.userData.own = mesh.material = mesh.material.clone(); // parts share one; each is lit alone
      mesh.castShadow = mesh.receiveShadow = true;
    }
  }
  const symbols = {
    axes: model.moving.flatMap((part) => jointSymbol(model, part, size)),
    collision: model.parts.map((part, k) => collisionSymbol(part, asset.bodies[k])),
  };
  const meshes = model.parts.flatMap((part) => part.meshes);
  const shown = { axes: false, collision: false, colors: false, wireframe: false };

  let waiting = false;
  const draw = () => {
    waiting = false;
    model.update();
    renderer.render(scene, camera);
  };
  const invalidate = () => {
    if (!waiting) requestAnimationFrame(draw);
    waiting = true;
  };

  const show = (what, on) => {
    shown[what] = on;
    for (const kind of ["axes", "collision"]) {
      for (const symbol of symbols[kind]) symbol.visible = shown[kind];
    }
    for (const mesh of meshes) {
      const flat = shown.colors || shown.wireframe; // white lines would be lost on white
      mesh.material = flat ? mesh.userData.part.flat : mesh.userData.own;
      mesh.material.wireframe = shown.wireframe;
      // the pieces lie in the surface, which would hide them
      mesh.material.transparent = shown.collision;
      mesh.material.opacity = shown.collision ? GHOST : 1;
      mesh.material.depthWrite = !shown.collision;
      mesh.material.needsUpdate = true;
    }
    light(lit);
  };

  let lit = null;
  const light = (part) => {
    lit = part;
    for (const mesh of meshes) {
      const on = part !== null && mesh.userData.part === part;
      mesh.material.emissive?.setHex(on ? 0x2a4470 : 0);
    }
    invalidate();
  };

  const recolor = () => {
    const style = getComputedStyle(document.documentElement);
    const value = (name) => style.getPropertyValue(name).trim();
    grid.lines.material.color.set(value("--grid"));
    shade.material.opacity = Number(value("--shadow"));
    invalidate();
  };

  // As near as all that is seen between rest and open allows.
  const frame = () => {
    const back = new THREE.Vector3(...asset.view.from);
    const right = new THREE.Vector3().crossVectors(camera.up, back).normalize();
    const top = new THREE.Vector3().crossVectors(back, right);
    const tall = Math.tan((camera.fov * Math.PI) / 360) / 1.12;
    let distance = 0;
    for (const corner of corners) {
      const from = corner.clone().sub(center);
      const wide = Math.max(
        Math.abs(from.dot(right)) / (tall * camera.aspect), Math.abs(from.dot(top)) / tall);
      distance = Math.max(distance, wide + from.dot(back));
    }
    camera.position.copy(center).addScaledVector(back, distance);
    camera.near = distance / 100;
    camera.far = distance + size * 20;
    camera.updateProjectionMatrix();
    controls.target.copy(center);
    controls.update();
    invalidate();
  };
  let touched = false; // once turned by hand, a resized window keeps the view
  const resize = () => {
    const { clientWidth: width, clientHeight: height } = canvas.parentElement;
    if (!width || !height) return;
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    if (touched) invalidate();
    else frame();
  };

  // The mouse. These listeners come before the orbit's, so that a drag of a part can switch it off.
  const caster = new THREE.Raycaster();
  const place = (event) => {
    const edge = canvas.getBoundingClientRect();
    return new THREE.Vector2(event.clientX - edge.left, event.clientY - edge.top);
  };
  const pixels = (point) => {
    const p = point.clone().project(camera);
    return new THREE.Vector2(((p.x + 1) / 2) * canvas.clientWidth, ((1 - p.y) / 2) * canvas.clientHeight);
  };
  const pick = (at) => {
    const x = (at.x / canvas.clientWidth) * 2 - 1;
    const y = 1 - (at.y / canvas.clientHeight) * 2;
    caster.setFromCamera(new THREE.Vector2(x, y), camera);
    return caster.intersectObjects(meshes, false)[0] ?? null;
  };
  let drag = null;
  const follow = (at) => {
    const { part, point } = drag;
    const span = part.joint.limits[1] - part.joint.limits[0];
    const step = new THREE.Matrix4();
    const seen = (q) => {
      const moved = jointMotion(part.joint, q, step).premultiply(part.home);
      return pixels(point.clone().applyMatrix4(moved.premultiply(part.node.parent.matrixWorld)));
    };
    for (let i = 0; i < 4; i++) { // Gauss-Newton: the grabbed point stays under the pointer
      const here = seen(part.q);
      const slope = seen(part.q + span * 1e-3).sub(here).divideScalar(1e-3);
      const error = at.clone().sub(here);
      const gain = error.dot(slope) / (slope.lengthSq() + DRAG_FROM ** 2);
      onMove(part, part.q + Math.min(Math.max(gain, -0.1), 0.1) * span);
    }
  };
  const hover = (part, at) => {
    if (part !== lit) {
      light(part);
      onMove.hover(part);
    }
    canvas.style.cursor = part && model.mover(part) ? "grab" : "";
    tip.hidden = !part;
    if (part) {
      tip.textContent = part.name;
      tip.style.transform = `translate(${Math.round(at.x + 14)}px, ${Math.round(at.y + 14)}px)`;
    }
  };
  canvas.addEventListener("pointerdown", (event) => {
    touched = true;
    if (event.button !== 0 || !event.isPrimary) return;
    const hit = pick(place(event));
    const part = hit && model.mover(hit.object.userData.part);
    if (!part) return;
    controls.enabled = false;
    canvas.setPointerCapture(event.pointerId);
    canvas.style.cursor = "grabbing";
    drag = { part, point: part.node.worldToLocal(hit.point.clone()) };
    onMove.grab();
  });
  canvas.addEventListener("pointermove", (event) => {
    const at = place(event);
    if (drag) follow(at);
    else if (event.buttons === 0) {
      const hit = pick(at);
      hover(hit ? hit.object.userData.part : null, at);
    } else hover(null, at);
  });
  const drop = () => {
    drag = null;
    controls.enabled = true;
  };
  canvas.addEventListener("pointerup", drop);
  canvas.addEventListener("pointercancel", drop);
  canvas.addEventListener("pointerleave", () => drag || hover(null));
  const controls = new THREE.OrbitControls(camera, canvas);
  controls.addEventListener("change", invalidate);
  controls.minDistance = size * 0.05;
  controls.maxDistance = size * 12;

  new ResizeObserver(resize).observe(canvas.parentElement);
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", recolor);
  resize();
  recolor();
  show("axes", false);
  return { invalidate, show, light, step: grid.step, extent: box, reset: () => { touched = false; frame(); } };
}
