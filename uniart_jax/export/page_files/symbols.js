// What is drawn beside the meshes: joint axes with their limits, collision shapes, the floor's grid.

const OVERLAY = { depthTest: false, depthWrite: false, transparent: true };

function attach(part, what) {
  // Children of a node are given in the object frame at the shown state.
  what.matrixAutoUpdate = false;
  what.matrix.copy(part.toPart);
  part.node.add(what);
  return what;
}

// An arrow along the axis; the way of the joint's anchor from limit to limit, filled towards the axis; a bead where it is now.
function jointSymbol(model, part, size) {
  const { joint } = part;
  const direction = new THREE.Vector3(...joint.direction);
  const origin = new THREE.Vector3(...joint.origin);
  const anchor = new THREE.Vector3(...joint.anchor);
  const [lo, hi] = joint.limits;
  const turns = joint.type !== "prismatic";
  const wide = turns ? anchor.distanceTo(foot(anchor, origin, direction)) : joint.open - joint.rest;
  const thick = size * 0.0045 * Math.min(Math.max((8 * Math.abs(wide)) / size, 0.45), 1);
  const solid = new THREE.MeshBasicMaterial({ color: part.ink, ...OVERLAY });
  const faint = new THREE.MeshBasicMaterial({
    color: part.ink, ...OVERLAY, opacity: 0.22, side: THREE.DoubleSide,
  });
  const still = new THREE.Group();

  const step = new THREE.Matrix4();
  const fromAxis = anchor.clone().sub(origin);
  const at = (q) => fromAxis.clone().applyMatrix4(jointMotion(joint, q, step)).add(origin);
  const pieces = turns ? Math.max(8, Math.ceil((hi - lo) / 0.07)) : 1;
  const states = Array.from({ length: pieces + 1 }, (_, i) => lo + ((hi - lo) * i) / pieces);
  const way = states.map(at);
  const curve = turns ? new THREE.CatmullRomCurve3(way) : null;
  if (turns) {
    still.add(new THREE.Mesh(new THREE.TubeGeometry(curve, pieces, thick * 0.7, 8), solid));
    const feet = way.map((p) => foot(p, origin, direction));
    const fan = [];
    for (let i = 0; i < pieces; i++) {
      fan.push(feet[i], way[i], way[i + 1], feet[i], way[i + 1], feet[i + 1]);
    }
    still.add(new THREE.Mesh(new THREE.BufferGeometry().setFromPoints(fan), faint));
    const middle = foot(anchor, origin, direction);
    const half = joint.reach + size * 0.05;
    still.add(arrow(middle.clone().addScaledVector(direction, -half),
      middle.clone().addScaledVector(direction, half), thick, solid));
    if (joint.type !== "continuous") {
      for (const i of [0, pieces]) still.add(rod(feet[i], way[i], thick * 0.5, solid));
    }
  } else {
    const opens = joint.open >= joint.rest;
    still.add(arrow(opens ? way[0] : way[1], opens ? way[1] : way[0], thick, solid));
    const side = sideways(direction).multiplyScalar(thick * 5);
    for (const end of way) {
      still.add(rod(end.clone().add(side), end.clone().sub(side), thick, solid));
    }
  }
  const bead = new THREE.Mesh(new THREE.SphereGeometry(thick * 2.4, 20, 14), solid);
  bead.position.copy(anchor);
  const carried = new THREE.Group();
  carried.add(bead);
  const symbols = [attach(model.parts[part.parent], still), attach(part, carried)];
  for (const group of symbols) group.traverse((o) => (o.renderOrder = 3));
  return symbols;
}

function foot(point, origin, direction) {
  const along = point.clone().sub(origin).dot(direction);
  return origin.clone().addScaledVector(direction, along);
}

function sideways(direction) {
  const up = Math.abs(direction.z) < 0.9 ? new THREE.Vector3(0, 0, 1) : new THREE.Vector3(1, 0, 0);
  return up.cross(direction).normalize();
}

function rod(from, to, radius, material) {
  const way = to.clone().sub(from);
  const length = Math.max(way.length(), 1e-9);
  const mesh = new THREE.Mesh(new THREE.CylinderGeometry(radius, radius, length, 10), material);
  mesh.position.copy(from).addScaledVector(way, 0.5);
  mesh.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), way.divideScalar(length));
  return mesh;
}

function arrow(from, to, radius, material) {
  const group = new THREE.Group();
  const way = to.clone().sub(from);
  const head = Math.min(radius * 6, way.length() / 2);
  way.normalize();
  const neck = to.clone().addScaledVector(way, -head);
  const cone = new THREE.Mesh(new THREE.ConeGeometry(head * 0.45, head, 16), material);
  cone.position.copy(neck).addScaledVector(way, head / 2);
  cone.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), way);
  group.add(rod(from, neck, radius * 0.7, material), cone);
  return group;
}

// A part's convex pieces, see-through, with their edges; neighbours in two shades.
function collisionSymbol(part, shapes) {
  const group = new THREE.Group();
  const shades = [part.color, new THREE.Color(part.color).lerp(new THREE.Color(0xffffff), 0.35)];
  const fills = shades.map((color) => new THREE.MeshStandardMaterial({
    color, roughness: 1, transparent: true, opacity: 0.42, depthWrite: false,
  }));
  const edge = new THREE.LineBasicMaterial({ color: part.ink });
  for (const [i, shape] of shapes.entries()) {
    let geometry;
    if (shape.size) {
      const [x, y, z] = shape.rotation; // rows
      geometry = new THREE.BoxGeometry(...shape.size);
      const [a, b, c] = shape.center;
      geometry.applyMatrix4(new THREE.Matrix4().set(...x, a, ...y, b, ...z, c, 0, 0, 0, 1));
    } else {
      const indexed = new THREE.BufferGeometry();
      const points = new Float32Array(shape.vertices);
      indexed.setAttribute("position", new THREE.BufferAttribute(points, 3));
      indexed.setIndex(shape.faces);
      geometry = indexed.toNonIndexed(); // flat faces
      geometry.computeVertexNormals();
    }
    const solid = new THREE.Mesh(geometry, fills[i % 2]);
    solid.renderOrder = 1;
    const lines = new THREE.LineSegments(new THREE.EdgesGeometry(geometry, 12), edge);
    lines.renderOrder = 2;
    group.add(solid, lines);
  }
  return attach(part, group);
}

// A grid that fades out, in steps of 1, 2 or 5 times a power of ten.
function floorGrid(center, floor, reach) {
  const rough = reach / 12;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 5].find((m) => m * power >= rough) ?? 10);
  const count = Math.ceil((reach * 2.5) / step);
  const [cx, cy] = [Math.round(center.x / step), Math.round(center.y / step)];
  const points = [];
  const colors = [];
  const put = (i, j) => {
    points.push((cx + i) * step, (cy + j) * step, floor);
    const far = Math.hypot(i, j) / count;
    colors.push(1, 1, 1, Math.max(0, 1 - far) ** 1.5);
  };
  for (let i = -count; i <= count; i++) {
    for (let j = -count; j < count; j++) {
      put(i, j), put(i, j + 1);
      put(j, i), put(j + 1, i);
    }
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points), 3));
  geometry.setAttribute("color", new THREE.BufferAttribute(new Float32Array(colors), 4));
  const material = new THREE.LineBasicMaterial({
    vertexColors: true, transparent: true, opacity: 0.4, depthWrite: false,
  });
  const lines = new THREE.LineSegments(geometry, material);
  lines.renderOrder = -1;
  return { lines, step };
}
