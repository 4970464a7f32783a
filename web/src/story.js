// What happens: a robot walks by somebody's policy, loses parts when told to, and goes on. No page in here either.
import { makePolicy } from './policy.js';
import { Robot } from './robot.js';
import { Mind } from './mind.js';

const STAND = 20; // control steps in which a robot stands before a policy that has learned from the stance takes over
const MEMORY = 20 * 60; // control steps of the past that are kept

/** Parts of a damage name in one order, so that `a+b` and `b+a` are the same. */
const key = (damage) => damage.split('+').sort().join('+');

export class Story {
  constructor(mj, page) {
    this.mj = mj;
    this.page = page;
    this.named = Object.fromEntries(Object.keys(page.damages).map((name) => [key(name), name]));
    this.sources = page.sources.map(ready);
    this.patience = 60;
    this.begin(0);
  }

  /** A new robot, walking by the policies of a run or an atlas. */
  begin(number, method) {
    this.source = this.sources[number];
    this.number = number;
    this.robot?.free();
    this.robot = new Robot(this.mj, this.page);
    if (this.source.finds_out && !this.mind) this.mind = new Mind(this.mj, this.page);
    this.mind?.forget();
    this.robot.goal = this.source.task === 'p2p' ? [1.7, 0] : null;
    this.robot.outwards = this.source.task === 'xy';
    this.time = 0;
    this.past = [];
    this.marks = [];
    this.lost = new Set();
    this.struck = -Infinity;
    this.standing = 0;
    this.substep = 0;
    this.follow(method ?? this.source.methods.at(-1).name);
  }

  /** From now on the robot goes by another method. */
  follow(name) {
    this.method = this.source.methods.find((method) => method.name === name);
    this.walker = this.wanted();
    this.marks.push({ step: this.past.length, time: this.time, text: this.method.said });
  }

  /** A damage of the page with one part more; undefined where the page has none such. */
  with(part) {
    const leg = part.split(/[_:]/)[1], whole = part.startsWith('leg_');
    const kept = [...this.lost].filter((own) => !(whole && own.split(/[_:]/)[1] === leg));
    return this.named[key([...kept, part].join('+'))];
  }

  lose(part) {
    const damage = this.with(part);
    if (!damage || damage === this.robot.damage) return false;
    this.robot.wear(damage);
    this.lost = new Set(damage.split('+'));
    this.struck = this.past.length;
    this.marks.push({ step: this.past.length, time: this.time, text: damage });
    return true;
  }

  repair() {
    this.robot.wear('healthy');
    this.lost = new Set();
    this.marks.push({ step: this.past.length, time: this.time, text: 'repaired' });
  }

  get finds_out() { return Boolean(this.source.finds_out); }

  /** Whose policy is to walk: the method's for the damage that it knows or supposes, or its fallback. */
  wanted() {
    const { policies, knows, fallback } = this.method;
    const damage = knows === 'nothing' ? 'healthy' : knows === 'supposed' ? this.supposed ?? 'healthy' : this.robot.damage;
    return policies[damage] ? { damage, policy: policies[damage] } : { damage: fallback.said, policy: fallback.policy };
  }

  /** One physics step; every third begins with a control step. */
  advance() {
    const { robot } = this;
    if (this.substep === 0) this.control();
    robot.substep();
    this.time += this.page.timestep;
    this.substep = (this.substep + 1) % this.page.substeps;
    if (this.substep === 0) this.feel();
  }

  control() {
    const patient = this.past.length - this.struck < this.patience;
    const wanted = this.wanted();
    if (!patient && wanted.policy !== this.walker.policy) {
      this.walker = wanted;
      this.marks.push({ step: this.past.length, time: this.time, text: `policy for ${wanted.damage}` });
      if (!this.source.takes_over) this.standing = STAND;
    }
    if (this.robot.goal && this.robot.towards().distance < this.page.goal_radius) this.reached();
    if (this.standing > 0 && --this.standing === 0) {
      this.robot.phase = 0;
      this.robot.straighten();
    }
    const still = this.standing > 0;
    this.action = still ? Array(18).fill(0) : Array.from(this.walker.policy.act(this.robot.observe(this.source.task, this.source.observation)));
    this.robot.aim(this.action);
  }

  feel() {
    const { robot } = this;
    robot.tick();
    if (this.finds_out) {
      this.mind.doubt(this.action, robot.senses, robot.present);
      this.supposed = this.mind.choose();
    }
    this.past.push({ x: robot.data.qpos[0], y: robot.data.qpos[1], time: this.time });
    if (this.past.length > MEMORY) {
      this.past.shift();
      this.struck -= 1;
      this.marks.forEach((mark) => { mark.step -= 1; });
      this.marks = this.marks.filter((mark) => mark.step >= 0);
    }
  }

  /** The goal of p2p was reached: another one, a golden angle further on. */
  reached() {
    this.turned = (this.turned ?? 0) + 2.4;
    const { qpos } = this.robot.data;
    this.robot.goal = [qpos[0] + 1.7 * Math.cos(this.turned), qpos[1] + 1.7 * Math.sin(this.turned)];
  }

  /** m/s over the last `window` control steps before one: along the heading, or with a goal over ground. */
  speed(step = this.past.length - 1, window = 20) {
    const [a, b] = [this.past[Math.max(step - window, 0)], this.past[step]];
    if (!a || !b || a === b) return 0;
    const [dx, dy] = [b.x - a.x, b.y - a.y], [hx, hy] = this.robot.heading;
    return (this.source.task === 'x' ? dx * hx + dy * hy : Math.hypot(dx, dy)) / (b.time - a.time);
  }
}

/** A source whose policies can act; methods of one set share them. */
function ready(source) {
  const sets = Object.fromEntries(Object.entries(source.sets).map(([name, set]) => [
    name, Object.fromEntries(Object.entries(set).map(([damage, policy]) => [damage, makePolicy(policy)])),
  ]));
  const fallback = sets.pi_B ? { said: 'the healthy robot (pi_B)', policy: sets.pi_B.healthy } : null;
  const methods = source.methods.map((method) => {
    const policies = sets[method.set];
    return { ...method, policies, fallback: fallback ?? { said: 'healthy', policy: policies.healthy } };
  });
  return { ...source, methods };
}

/** The part of a damage that a click on a link means. */
export function part(segment, leg, what) {
  if (what === 'leg' || (what === 'removed' && segment === 'coxa')) return `leg_${leg}`;
  if (what === 'leg:limp') return `leg_${leg}:limp`;
  return what === 'removed' ? `${segment}_${leg}` : `${segment}_${leg}:${what}`;
}
