// The object: joints from JSON, meshes from the GLB, and what the joints do to them.
// Metres and radians; the root's frame is the object frame (z up) at the shown state.

function* lineage(parts, k) {
  for (; k >= 0; k = parts[k].parent) yield parts[k];
}

// A joint's motion in the frame of its part's node, whose origin lies on the axis.
function jointMotion(joint, q, target) {
  const [x, y, z] = joint.direction;
  if (joint.type === "prismatic") target.identity();
  else target.makeRotationAxis(new THREE.Vector3(x, y, z), q);
  const way = joint.pitch * q;
  return target.setPosition(x * way, y * way, z * way);
}

// The GLB and three.js are gzip in base64.
async function unpack(base64) {
  const packed = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

// The page's policy lets this script run and no other: it knows its hash.
async function addThree(base64) {
  const script = document.createElement("script");
  script.textContent = new TextDecoder().decode(await unpack(base64));
  document.head.append(script);
  if (!window.THREE) throw new Error("three.js was not allowed to run");
}

async function loadModel(asset, base64) {
  const gltf = await new THREE.GLTFLoader().parseAsync(await unpack(base64), "");
  const nodes = new Map(); // by the name in the file: the loader changes names
  gltf.scene.traverse((node) => {
    const index = gltf.parser.associations.get(node)?.nodes;
    if (index !== undefined) nodes.set(gltf.parser.json.nodes[index].name, node);
  });
  const parts = asset.parts.map((part, index) => {
    const node = nodes.get(part.name);
    if (!node) throw new Error(`the GLB has no node for part "${part.name}"`);
    return { ...part, index, node, q: 0, meshes: [] };
  });
  const owner = new Map(parts.map((part) => [part.node, part]));
  gltf.scene.traverse((node) => {
    if (!node.isMesh) return;
    let at = node;
    while (at && !owner.has(at)) at = at.parent;
    if (at) owner.get(at).meshes.push(node);
  });

  // glTF is y-up; the root part's node tells how the file was turned.
  gltf.scene.updateMatrixWorld(true);
  const root = new THREE.Group();
  root.matrixAutoUpdate = false;
  root.matrix.extractRotation(parts.find((p) => p.parent < 0).node.matrixWorld).invert();
  root.add(gltf.scene);
  root.updateMatrixWorld(true);
  for (const part of parts) {
    part.home = part.node.matrix.clone();
    part.toPart = part.node.matrixWorld.clone().invert(); // object frame -> node, shown state
    part.node.matrixAutoUpdate = false;
  }

  const model = { root, parts, moving: parts.filter((p) => p.joint) };
  model.set = (part, q) => {
    const [lo, hi] = part.joint.limits;
    part.q = Math.min(Math.max(q, lo), hi);
    jointMotion(part.joint, part.q, part.node.matrix).premultiply(part.home);
    part.node.matrixWorldNeedsUpdate = true;
  };
  model.update = () => root.updateMatrixWorld(true);
  // Where each part stands: from the shown state to now, object frame, 16 numbers by columns.
  model.matrices = () => {
    model.update();
    return Object.fromEntries(
      parts.map((p) => [p.name, p.node.matrixWorld.clone().multiply(p.toPart).toArray()]),
    );
  };
  // The joint that moves a part: its own, or the nearest above it.
  model.mover = (part) => {
    for (const above of lineage(parts, part.index)) if (above.joint) return above;
    return null;
  };
  // Corners of all parts' boxes over the shown, rest and open states, and half way.
  model.reach = () => {
    const states = [() => 0, (j) => j.rest, (j) => j.open, (j) => (j.rest + j.open) / 2];
    const corners = [];
    for (const state of states) {
      for (const part of model.moving) model.set(part, state(part.joint));
      model.update();
      for (const part of parts) {
        for (const mesh of part.meshes) {
          mesh.geometry.boundingBox ?? mesh.geometry.computeBoundingBox();
          const { min, max } = mesh.geometry.boundingBox;
          for (let i = 0; i < 8; i++) {
            const corner = new THREE.Vector3(
              i & 1 ? max.x : min.x,
              i & 2 ? max.y : min.y,
              i & 4 ? max.z : min.z,
            );
            corners.push(corner.applyMatrix4(mesh.matrixWorld));
          }
        }
      }
    }
    for (const part of model.moving) model.set(part, 0);
    model.update();
    return corners;
  };
  return model;
}
