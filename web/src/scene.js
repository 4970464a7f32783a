// The robot as it is seen: three.js meshes of the model's own shapes, and parts that fall off.
import * as THREE from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';

const LINK = /^(coxa|femur|tibia)_([rl][fmr])$/;

export class Scene {
  constructor(canvas, mj, robot, { plain = false } = {}) {
    this.canvas = canvas;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: !plain });
    this.renderer.shadowMap.enabled = !plain;
    this.scene = new THREE.Scene();
    this.pieces = [];
    this.look();
    this.light();
    this.ground();
    this.build(mj, robot);
  }

  look() {
    THREE.Object3D.DEFAULT_UP.set(0, 0, 1);
    this.camera = new THREE.PerspectiveCamera(40, 1, 0.02, 30);
    this.camera.up.set(0, 0, 1);
    this.camera.position.set(-0.55, -0.85, 0.6);
    this.controls = new OrbitControls(this.camera, this.canvas);
    this.controls.target.set(0, 0, 0.06);
    this.controls.enableDamping = true;
    this.controls.maxPolarAngle = 1.5;
    const dark = window.matchMedia('(prefers-color-scheme: dark)');
    const sky = () => {
      const colour = dark.matches ? 0x20262e : 0xdfe6ee;
      this.scene.background = new THREE.Color(colour);
      this.scene.fog = new THREE.Fog(colour, 2.5, 7);
    };
    dark.addEventListener('change', sky);
    sky();
  }

  light() {
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x8899aa, 1.6));
    this.sun = new THREE.DirectionalLight(0xffffff, 2.2);
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.set(1024, 1024);
    Object.assign(this.sun.shadow.camera, { left: -0.6, right: 0.6, top: 0.6, bottom: -0.6, near: 0.1, far: 4 });
    this.scene.add(this.sun, this.sun.target);
  }

  ground() {
    const tile = document.createElement('canvas');
    tile.width = tile.height = 128;
    const pen = tile.getContext('2d');
    pen.fillStyle = '#c8cacd';
    pen.fillRect(0, 0, 128, 128);
    pen.fillStyle = '#b4b8bd';
    pen.fillRect(0, 0, 64, 64);
    pen.fillRect(64, 64, 64, 64);
    const checker = new THREE.CanvasTexture(tile);
    checker.wrapS = checker.wrapT = THREE.RepeatWrapping;
    checker.repeat.set(80, 80);
    checker.anisotropy = 8;
    checker.colorSpace = THREE.SRGBColorSpace;
    this.floor = new THREE.Mesh(new THREE.PlaneGeometry(40, 40), new THREE.MeshStandardMaterial({ map: checker, roughness: 0.95 }));
    this.floor.receiveShadow = true;
    this.flag = new THREE.Mesh(new THREE.CylinderGeometry(0.15, 0.15, 0.004, 40).rotateX(Math.PI / 2), new THREE.MeshStandardMaterial({ color: 0x2a9d5c }));
    this.flag.visible = false;
    this.scene.add(this.floor, this.flag);
  }

  build(mj, robot) {
    const { model } = robot, kind = mj.mjtObj.mjOBJ_BODY.value;
    this.names = Array.from({ length: model.nbody }, (_, b) => mj.mj_id2name(model, kind, b));
    this.bodies = this.names.map((name) => { const group = new THREE.Group(); group.name = name; this.scene.add(group); return group; });
    for (let g = 0; g < model.ngeom; g++) {
      const mesh = shape(mj, model, g);
      if (!mesh) continue;
      const body = this.bodies[model.geom_bodyid[g]];
      const [, segment, leg] = LINK.exec(body.name) ?? [];
      mesh.userData = { segment, leg };
      body.add(mesh);
    }
  }

  body(name) { return this.bodies[this.names.indexOf(name)]; }

  place({ data: { xpos, xquat } }) {
    this.bodies.forEach((body, i) => {
      body.position.set(xpos[3 * i], xpos[3 * i + 1], xpos[3 * i + 2]);
      body.quaternion.set(xquat[4 * i + 1], xquat[4 * i + 2], xquat[4 * i + 3], xquat[4 * i]);
    });
  }

  /** Shows which links are there; those that have just gone hop away and come to rest. */
  wear(robot) {
    this.place(robot);
    const joints = [];
    this.names.forEach((name) => LINK.test(name) && joints.push(name));
    const gone = joints.filter((name, i) => !robot.present[i] && this.body(name).visible);
    gone.filter((name) => !gone.some((other) => other !== name && above(other, name))).forEach((name) => this.drop(name, gone));
    joints.forEach((name, i) => { this.body(name).visible = robot.present[i]; });
  }

  drop(first, gone) {
    const piece = new THREE.Group(), base = this.body(first);
    piece.position.copy(base.position);
    this.scene.add(piece);
    piece.updateMatrixWorld();
    const [, , leg] = LINK.exec(first);
    gone.filter((name) => LINK.exec(name)[2] === leg).forEach((name) => piece.attach(this.body(name).clone()));
    const out = base.position.clone().sub(this.body('torso').position).setZ(0).normalize();
    this.pieces.push({ piece, v: out.clone().multiplyScalar(0.5).setZ(0.9), w: out.cross(new THREE.Vector3(0, 0, -6)) });
  }

  fall(seconds) {
    const box = new THREE.Box3();
    for (const part of this.pieces.filter(({ rest }) => !rest)) {
      part.v.z -= 9.81 * seconds;
      part.piece.position.addScaledVector(part.v, seconds);
      if (part.w.length() > 1e-3) part.piece.rotateOnWorldAxis(part.w.clone().normalize(), part.w.length() * seconds);
      const low = box.setFromObject(part.piece, true).min.z; // whatever is lowest touches
      if (low >= 0) continue;
      part.piece.position.z -= low;
      if (part.v.z < 0) {
        part.v.set(0.6 * part.v.x, 0.6 * part.v.y, -0.3 * part.v.z);
        part.w.multiplyScalar(0.75);
      }
      part.rest = part.v.length() < 0.08 && part.w.length() < 0.5;
    }
  }

  tidy() { this.pieces.splice(0).forEach(({ piece }) => this.scene.remove(piece)); }

  /** What lies under a pointer: a link { segment, leg }, a place on the floor { point }, or nothing. */
  under(event) {
    const at = this.canvas.getBoundingClientRect(), ray = new THREE.Raycaster();
    const x = (2 * (event.clientX - at.left)) / at.width - 1, y = 1 - (2 * (event.clientY - at.top)) / at.height;
    ray.setFromCamera(new THREE.Vector2(x, y), this.camera);
    const links = this.bodies.filter((body) => body.visible && LINK.test(body.name));
    const hit = ray.intersectObjects(links, true)[0];
    if (hit) return hit.object.userData;
    const ground = ray.intersectObject(this.floor)[0];
    return ground ? { point: [ground.point.x, ground.point.y] } : {};
  }

  /** Where a link is on the screen; for tests. */
  screen(name) {
    const p = this.body(name).localToWorld(new THREE.Vector3(0.03, 0, 0)).project(this.camera);
    const at = this.canvas.getBoundingClientRect();
    return { x: at.left + ((p.x + 1) / 2) * at.width, y: at.top + ((1 - p.y) / 2) * at.height };
  }

  draw(robot, left = 0) {
    const { canvas, renderer, camera, controls } = this, { clientWidth: w, clientHeight: h } = canvas;
    const size = renderer.getSize(new THREE.Vector2());
    if (size.x !== w || size.y !== h) {
      renderer.setSize(w, h, false);
      camera.aspect = w / h;
      if (left) camera.setViewOffset(w, h, -left / 2, 0, w, h);
      else camera.clearViewOffset();
      camera.updateProjectionMatrix();
    }
    this.place(robot);
    if (robot.goal) this.flag.position.set(...robot.goal, 0.001);
    this.flag.visible = Boolean(robot.goal);
    const torso = this.body('torso').position, dx = torso.x - controls.target.x, dy = torso.y - controls.target.y;
    controls.target.x += dx;
    controls.target.y += dy;
    camera.position.x += dx;
    camera.position.y += dy;
    // The floor moves along by whole tiles, so that it never ends.
    this.floor.position.set(Math.round(torso.x), Math.round(torso.y), 0);
    this.sun.target.position.set(torso.x, torso.y, 0);
    this.sun.position.set(torso.x - 0.6, torso.y - 0.7, 1.8);
    controls.update();
    renderer.render(this.scene, camera);
  }
}

const SEGMENTS = ['coxa', 'femur', 'tibia'];

/** Whether one link carries another. */
function above(one, other) {
  const [[, a, leg], [, b, its]] = [LINK.exec(one), LINK.exec(other)];
  return leg === its && SEGMENTS.indexOf(a) < SEGMENTS.indexOf(b);
}

function shape(mj, model, g) {
  const { mjtGeom: kinds } = mj, s = model.geom_size.slice(3 * g, 3 * g + 3);
  const geometry = {
    [kinds.mjGEOM_SPHERE.value]: () => new THREE.SphereGeometry(s[0], 20, 14),
    [kinds.mjGEOM_BOX.value]: () => new THREE.BoxGeometry(2 * s[0], 2 * s[1], 2 * s[2]),
    [kinds.mjGEOM_CAPSULE.value]: () => new THREE.CapsuleGeometry(s[0], 2 * s[1], 6, 16).rotateX(Math.PI / 2),
  }[model.geom_type[g]];
  if (!geometry) return null;
  const material = model.geom_matid[g], rgba = material >= 0 ? model.mat_rgba.slice(4 * material) : model.geom_rgba.slice(4 * g);
  const colour = new THREE.Color().setRGB(rgba[0], rgba[1], rgba[2], THREE.SRGBColorSpace);
  const mesh = new THREE.Mesh(geometry(), new THREE.MeshStandardMaterial({ color: colour, roughness: 0.5, metalness: 0.1 }));
  mesh.castShadow = true;
  mesh.position.fromArray(model.geom_pos, 3 * g);
  const q = model.geom_quat.slice(4 * g, 4 * g + 4);
  mesh.quaternion.set(q[1], q[2], q[3], q[0]);
  return mesh;
}
