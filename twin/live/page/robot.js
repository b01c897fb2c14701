// geometry.json as objects of three.js: a group per body, housings with a material of their joint.

/// Housings glow for two thirds, so that light and shadow change their colour little: as in tribotwin-report.
const glowing = 0.7, lit = 0.35;
const round = 40;  // sides of a circle

function capsule(THREE, [radius, half]) {
  const profile = [], steps = 10;
  for (let i = 0; i <= 2 * steps; ++i) {
    const angle = Math.PI * (i / (2 * steps) - 0.5);
    const end = i === steps ? [-half, half] : [i < steps ? -half : half];
    for (const middle of end)
      profile.push(new THREE.Vector2(radius * Math.cos(angle), middle + radius * Math.sin(angle)));
  }
  return new THREE.LatheBufferGeometry(profile, round).rotateX(Math.PI / 2);
}

function mesh(THREE, { vertices, faces }) {
  const made = new THREE.BufferGeometry();
  made.setAttribute('position', new THREE.BufferAttribute(Float32Array.from(vertices), 3));
  made.setIndex(new THREE.BufferAttribute(Uint32Array.from(faces), 1));
  return made;
}

const shapes = {
  box: (THREE, [x, y, z]) => new THREE.BoxBufferGeometry(2 * x, 2 * y, 2 * z),
  sphere: (THREE, [radius]) => new THREE.SphereBufferGeometry(radius, round, round / 2),
  ellipsoid: (THREE, [x, y, z]) => new THREE.SphereBufferGeometry(1, round, round / 2).scale(x, y, z),
  cylinder: (THREE, [radius, half]) =>
    new THREE.CylinderBufferGeometry(radius, radius, 2 * half, round).rotateX(Math.PI / 2),
  capsule,
  plane: (THREE, [x, y]) => new THREE.PlaneBufferGeometry(2 * x, 2 * y),
};

export class Robot {
  constructor(THREE, geometry) {
    this.THREE = THREE;
    this.root = new THREE.Group();
    this.geometries = [];
    this.materials = new Map();
    this.housings = new Map();  // joint: {material, parts, outlines, edge}
    this.pickable = [];
    this.meshes = geometry.meshes.map((each) => this.keep(mesh(THREE, each)));
    this.joints = this.jointsOf(geometry.bodies);
    this.bodies = geometry.bodies.map((body, i) => this.body(body, i));
    this.root.add(...this.bodies);
  }

  keep(geometry) {
    this.geometries.push(geometry);
    return geometry;
  }

  /// The joint that moves a body: its own, else that of the body which carries it.
  jointsOf(bodies) {
    const joints = [];
    bodies.forEach((body, i) => joints.push(body.joint ?? (body.parent < i ? joints[body.parent] : null) ?? null));
    return joints;
  }

  body(body, index) {
    const group = new this.THREE.Group();
    group.matrixAutoUpdate = false;
    for (const geom of body.geoms) {
      const endless = geom.type === 'plane' && !(geom.size[0] > 0 && geom.size[1] > 0);
      if (endless || (geom.type === 'plane' && index === 0)) continue;  // the floor is drawn by the scene
      const part = this.part(geom);
      part.userData = { joint: geom.housing ?? this.joints[index], fixed: index === 0 };
      group.add(part);
      this.pickable.push(part);
    }
    return group;
  }

  part(geom) {
    const { THREE } = this;
    const shape = geom.type === 'mesh' ? this.meshes[geom.mesh] : this.keep(shapes[geom.type](THREE, geom.size));
    const part = new THREE.Mesh(shape, geom.housing ? this.housing(geom).material : this.material(geom));
    part.position.set(...geom.pos);
    const [w, x, y, z] = geom.quat;
    part.quaternion.set(x, y, z, w);
    if (geom.housing) this.outline(part, this.housings.get(geom.housing));
    return part;
  }

  material({ rgba, type }) {
    const key = JSON.stringify([rgba, type === 'mesh']);
    if (!this.materials.has(key))
      this.materials.set(key, new this.THREE.MeshPhongMaterial({ color: new this.THREE.Color(...rgba.slice(0, 3)),
        specular: 0x222222, shininess: 30, flatShading: type === 'mesh', opacity: rgba[3], transparent: rgba[3] < 1 }));
    return this.materials.get(key);
  }

  housing({ housing: joint, type }) {
    if (!this.housings.has(joint)) {
      const { THREE } = this;
      const material = new THREE.MeshPhongMaterial({ specular: 0, flatShading: type === 'mesh' });
      const edge = new THREE.MeshBasicMaterial({ side: THREE.BackSide });
      this.materials.set('housing ' + joint, material).set('edge ' + joint, edge);
      this.housings.set(joint, { material, edge, parts: [], outlines: [] });
      this.colour(joint, null);
    }
    return this.housings.get(joint);
  }

  /// A larger one behind it, of which only the rim is seen.
  outline(part, housing) {
    const rim = new this.THREE.Mesh(part.geometry, housing.edge);
    part.geometry.computeBoundingBox();
    const size = part.geometry.boundingBox.getSize(new this.THREE.Vector3());
    const thick = 0.18 * Math.max(size.x, size.y, size.z);
    rim.scale.set(...[size.x, size.y, size.z].map((side) => (side > 0 ? (side + thick) / side : 1)));
    rim.visible = false;
    part.add(rim);
    housing.parts.push(part);
    housing.outlines.push(rim);
  }

  /// [red, green, blue] of 0..255; null: not known, grey.
  colour(joint, colour) {
    const housing = this.housings.get(joint);
    const [r, g, b] = (colour ?? [128, 128, 128]).map((part) => part / 255);
    housing?.material.color.setRGB(lit * r, lit * g, lit * b);
    housing?.material.emissive.setRGB(glowing * r, glowing * g, glowing * b);
  }

  /// A rim in this colour of CSS; null: none.
  mark(joint, colour) {
    const housing = this.housings.get(joint);
    if (!housing) return;
    for (const rim of housing.outlines) rim.visible = colour !== null;
    if (colour !== null) housing.edge.color.set(colour);
  }

  /// position [m] and quaternion w x y z of each body.
  pose(values) {
    const { THREE } = this, one = new THREE.Vector3(1, 1, 1);
    const place = new THREE.Vector3(), turned = new THREE.Quaternion();
    this.bodies.forEach((body, i) => {
      const [x, y, z, qw, qx, qy, qz] = values.subarray(7 * i, 7 * i + 7);
      body.matrix.compose(place.set(x, y, z), turned.set(qx, qy, qz, qw), one);
      body.matrixWorldNeedsUpdate = true;
    });
    this.root.updateMatrixWorld(true);
  }

  /// Middle of a joint's housing in the world; null where it has none.
  middle(joint) {
    const part = this.housings.get(joint)?.parts[0];
    if (!part) return null;
    return part.geometry.boundingBox.getCenter(new this.THREE.Vector3()).applyMatrix4(part.matrixWorld);
  }

  /// A box around what moves and what carries it; around all where nothing does.
  box() {
    const box = new this.THREE.Box3();
    const moving = this.pickable.filter((part) => !part.userData.fixed);
    for (const part of moving.length ? moving : this.pickable) {
      part.geometry.computeBoundingBox();
      box.union(part.geometry.boundingBox.clone().applyMatrix4(part.matrixWorld));
    }
    return box;
  }

  dispose() {
    for (const geometry of this.geometries) geometry.dispose();
    for (const material of this.materials.values()) material.dispose();
  }
}
