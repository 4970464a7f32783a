// The robot: MuJoCo's model with the leaves of a damage, its senses, and one control step. No page in here.

/** Sine and cosine terms of a unit quaternion: the rotation from body to world, row by row. */
export function rotation([w, x, y, z]) {
  return [
    1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
    2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
    2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
  ];
}

/** Standard normal numbers from a seed (mulberry32, Box-Muller), so that a page tells the same story again. */
export function normals(seed) {
  let state = seed >>> 0;
  const uniform = () => {
    state = (state + 0x6d2b79f5) >>> 0;
    let t = Math.imul(state ^ (state >>> 15), state | 1);
    t ^= t + Math.imul(t ^ (t >>> 7), t | 61);
    return ((t ^ (t >>> 14)) >>> 0) / 2 ** 32;
  };
  return () => Math.sqrt(-2 * Math.log(1 - uniform())) * Math.cos(2 * Math.PI * uniform());
}

/** A model and its state; the leaves of any damage of the page can be put into it while it walks. */
export class Body {
  constructor(mj, page) {
    this.mj = mj;
    this.page = page;
    this.model = mj.MjModel.from_xml_string(page.xml);
    this.data = new mj.MjData(this.model);
    this.healthy = {};
    mj.mj_resetDataKeyframe(this.model, this.data, 0);
    this.stance = Float64Array.from(this.data.qpos);
    this.wear('healthy');
    this.stand();
  }

  /** Takes on a damage: the leaves that differ from the healthy model's, as the package has computed them. */
  wear(damage) {
    const leaves = this.page.damages[damage];
    for (const [field, values] of Object.entries(this.healthy)) this.model[field].set(values);
    for (const [field, { at, value }] of Object.entries(leaves.changed)) {
      this.healthy[field] ??= Float64Array.from(this.model[field]);
      at.forEach((index, k) => { this.model[field][index] = value[k]; });
    }
    this.damage = damage;
    this.present = Array.from({ length: 18 }, (_, joint) => !leaves.silent.includes(joint));
  }

  stand() {
    this.mj.mj_resetDataKeyframe(this.model, this.data, 0);
    this.data.ctrl.set(this.stance.subarray(7));
    this.mj.mj_forward(this.model, this.data);
  }

  /** Position targets of an action; null: the stance. */
  aim(action) {
    const { ctrl } = this.data, { action_scale: scale } = this.page;
    for (let i = 0; i < 18; i++) ctrl[i] = this.stance[7 + i] + (action ? scale[i] * action[i] : 0);
  }

  substep() { this.mj.mj_step(this.model, this.data); }

  /** What is felt: joint angles about the stance (18), gyroscope (3), gravity in the body's frame (3). */
  felt() {
    const { qpos, qvel } = this.data, R = rotation(qpos.subarray(3, 7));
    const joints = Array.from({ length: 18 }, (_, i) => (this.present[i] ? qpos[7 + i] - this.stance[7 + i] : 0));
    return [...joints, qvel[3], qvel[4], qvel[5], -R[6], -R[7], -R[8]];
  }

  free() { this.data.delete(); this.model.delete(); }
}

/** The robot that walks: a body with a clock, a task and noisy senses. */
export class Robot extends Body {
  constructor(mj, page, seed = 1) {
    super(mj, page);
    this.normal = normals(seed);
    this.noise = 1;
    this.phase = 0;
    this.heading = [1, 0]; // task x: where to walk; the task is the same in every direction
    this.goal = null; // task p2p
    this.outwards = false; // task xy
    this.feel();
  }

  /** Reads the senses once: what the policy sees and what the belief is told are the same reading. */
  feel() {
    const { page, data } = this, noise = page.noise, exact = this.felt();
    const drawn = (name) => this.noise * noise[name] * this.normal();
    const names = [...Array(18).fill('joints'), ...Array(3).fill('gyroscope'), ...Array(3).fill('gravity')];
    this.senses = exact.map((v, i) => (i < 18 && !this.present[i] ? 0 : v + drawn(names[i])));
    this.speeds = this.present.map((there, i) => (there ? data.qvel[6 + i] + drawn('speeds') : 0));
  }

  /** Unit vector in the body's plane, ahead and left, that the task rewards going along; and the distance, m. */
  towards() {
    const { qpos } = this.data, R = rotation(qpos.subarray(3, 7));
    const norm = Math.max(Math.hypot(R[0], R[3]), 1e-6), [hx, hy] = [R[0] / norm, R[3] / norm];
    let [gx, gy] = this.heading;
    if (this.goal) [gx, gy] = [this.goal[0] - qpos[0], this.goal[1] - qpos[1]];
    if (this.outwards) [gx, gy] = [qpos[0] + 0.1, qpos[1]];
    const distance = Math.hypot(gx, gy);
    [gx, gy] = [gx / Math.max(distance, 1e-6), gy / Math.max(distance, 1e-6)];
    return { ahead: gx * hx + gy * hy, left: hx * gy - hy * gx, distance };
  }

  /** The observation, see srl_jax/env/senses.py. */
  observe(task, kind) {
    const { data } = this, { ahead, left, distance } = this.towards(), angle = 2 * Math.PI * this.phase;
    const joints = this.senses.slice(0, 18), gyroscope = this.senses.slice(18, 21), gravity = this.senses.slice(21);
    const seen = [Math.sin(angle), Math.cos(angle), ahead, left];
    if (task === 'p2p') seen.push(Math.min(distance, 2));
    seen.push(...gravity, ...joints);
    if (kind === 'full') {
      const R = rotation(data.qpos.subarray(3, 7)), v = data.qvel;
      for (let i = 0; i < 3; i++) seen.push(R[i] * v[0] + R[3 + i] * v[1] + R[6 + i] * v[2]);
    }
    if (kind !== 'onboard') seen.push(...gyroscope.map((v) => 0.3 * v), ...this.speeds.map((v) => 0.1 * v));
    if (kind === 'full') seen.push(10 * data.qpos[2]);
    return seen;
  }

  /** The clock and the senses after a control step. */
  tick() {
    this.phase = (this.phase + this.page.clock_hz / this.page.control_hz) % 1;
    this.feel();
  }

  /** Takes the present heading as the direction to walk in. */
  straighten() {
    const R = rotation(this.data.qpos.subarray(3, 7)), norm = Math.max(Math.hypot(R[0], R[3]), 1e-6);
    this.heading = [R[0] / norm, R[3] / norm];
  }

  get tipped() { return rotation(this.data.qpos.subarray(3, 7))[8] < this.page.upright; }
}
