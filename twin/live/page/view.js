// A robot of three.js in a canvas: light, floor, eye and the drawing itself.
import { Orbit } from './orbit.js';
import { Robot } from './robot.js';

const fovy_deg = 34, filled = 1.06;
const mostPixels = 4e6, softwarePixels = 1e6;

/// A context of WebGL on this canvas, or null.
function contextOf(canvas) {
  const wanted = { antialias: true, alpha: true, powerPreference: 'low-power' };
  return canvas.getContext('webgl2', wanted) ?? canvas.getContext('webgl', wanted);
}

function isSoftware(gl) {
  const more = gl.getExtension('WEBGL_debug_renderer_info');
  return /swiftshader|llvmpipe|softpipe|software/i.test(more ? gl.getParameter(more.UNMASKED_RENDERER_WEBGL) : '');
}

export class View {
  /// changed(): the eye moved; clicked(x, y): of the canvas, in pixels.
  constructor(canvas, changed, clicked) {
    Object.assign(this, { canvas, robot: null });
    this.orbit = new Orbit(canvas, changed, clicked);
  }

  /// load(): three.js. False where the browser has no WebGL.
  async start(load) {
    const context = contextOf(this.canvas);
    if (!context) return false;
    const THREE = this.THREE = await load();
    this.software = isSoftware(context);
    this.renderer = new THREE.WebGLRenderer({ canvas: this.canvas, context, antialias: true, alpha: true });
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(fovy_deg, 1, 0.01, 100);
    this.camera.up.set(0, 0, 1);
    const key = new THREE.DirectionalLight(0xffffff, 0.45), fill = new THREE.DirectionalLight(0xdfe8ff, 0.15);
    key.position.set(-0.42, -0.38, 1);
    fill.position.set(0.7, -0.5, 0.35);
    const head = this.head = new THREE.DirectionalLight(0xffffff, 0.35);  // comes with the eye
    this.scene.add(key, fill, head, head.target, new THREE.HemisphereLight(0xffffff, 0x9098a8, 0.5));
    return true;
  }

  build(geometry) {
    this.robot = new Robot(this.THREE, geometry);
    this.scene.add(this.robot.root);
    this.from = geometry.eye;
    this.framed = false;
  }

  /// With all that the graphics hold of the robot.
  forget() {
    if (!this.robot) return;
    this.scene.remove(this.robot.root);
    this.robot.dispose();
    this.forgetFloor();
    this.renderer.renderLists.dispose();
    this.robot = null;
  }

  forgetFloor() {
    if (!this.floor) return;
    this.scene.remove(this.floor);
    this.floor.geometry.dispose();
    this.floor.material.dispose();
    this.floor = null;
  }

  /// The colour of CSS of the floor's lines.
  rule(colour) {
    this.line = colour;
    if (!this.floor) return;
    this.floor.material.vertexColors = 0;
    this.floor.material.color.set(colour);
    this.floor.material.needsUpdate = true;
  }

  /// So that the robot is seen whole in all these poses; the last of them stays.
  frame(poses) {
    const { THREE } = this, box = new THREE.Box3();
    for (const pose of poses) {
      this.robot.pose(pose);
      box.union(this.robot.box());
    }
    if (box.isEmpty()) box.set(new THREE.Vector3(-0.5, -0.5, 0), new THREE.Vector3(0.5, 0.5, 1));
    const ball = box.getBoundingSphere(new THREE.Sphere());
    this.radius = Math.max(ball.radius, 1e-3);
    this.orbit.place(ball.center.toArray(), this.distance(box, ball.center), this.from);
    this.forgetFloor();
    const size = 10 ** Math.ceil(Math.log10(this.radius)) / 2;
    const lines = 2 * Math.ceil(2.2 * this.radius / size * 5);
    this.floor = new THREE.GridHelper(lines * size / 5, lines);
    this.floor.rotateX(Math.PI / 2);
    this.floor.position.z = Math.min(0, box.min.z);
    this.rule(this.line);
    this.scene.add(this.floor);
    this.framed = true;
  }

  /// From which all corners of the box are in the picture.
  distance(box, centre) {
    const { THREE, from } = this, back = new THREE.Vector3(...from).normalize();
    const right = new THREE.Vector3(0, 0, 1).cross(back).normalize(), up = back.clone().cross(right);
    const slope = Math.tan(this.camera.fov * Math.PI / 360);
    const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((i) => new THREE.Vector3(box[i & 1 ? 'max' : 'min'].x,
      box[i & 2 ? 'max' : 'min'].y, box[i & 4 ? 'max' : 'min'].z).sub(centre));
    return filled * Math.max(...corners.map((corner) => corner.dot(back) + Math.max(
      Math.abs(corner.dot(right)) / (slope * this.camera.aspect), Math.abs(corner.dot(up)) / slope)));
  }

  /// A pose as Robot.pose takes it; where the robot is not framed yet, around `poses`.
  draw(pose, width, height, poses = [pose]) {
    const { renderer, camera, orbit, robot } = this;
    this.resize(width, height);
    if (!this.framed) this.frame(poses);
    robot.pose(pose);
    camera.position.set(...orbit.eye());
    this.head.position.set(...orbit.eye());
    this.head.target.position.set(...orbit.target);
    camera.lookAt(...orbit.target);
    camera.near = Math.max(orbit.distance / 100, orbit.distance - 20 * this.radius);
    camera.far = orbit.distance + 20 * this.radius;
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld();
    renderer.render(this.scene, camera);
  }

  resize(width, height) {
    const most = this.software ? softwarePixels : mostPixels;
    const ratio = Math.min(devicePixelRatio || 1, Math.sqrt(most / (width * height)));
    if (this.size === `${width} ${height} ${ratio}`) return;
    this.size = `${width} ${height} ${ratio}`;
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    // What fits into a square fits into the picture, whichever side is longer.
    const half = Math.tan(fovy_deg * Math.PI / 360) / Math.min(1, width / height);
    this.camera.fov = 360 / Math.PI * Math.atan(half);
  }

  /// The joint of the part at this place of the picture.
  pick(x, y) {
    const { THREE, canvas } = this, ray = new THREE.Raycaster();
    ray.setFromCamera({ x: 2 * x / canvas.clientWidth - 1, y: 1 - 2 * y / canvas.clientHeight }, this.camera);
    return ray.intersectObjects(this.robot.pickable)[0]?.object.userData.joint;
  }
}
