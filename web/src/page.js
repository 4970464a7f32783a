// The page: what the visitor does becomes the story, and the story is shown.
import { drawBelief, drawSpeed } from './chart.js';
import { Scene } from './scene.js';
import { Story, part } from './story.js';

const $ = (id) => document.getElementById(id);
const PANEL = 332; // px beside which the robot is centred
const LOCKED = 'locked';

export class Page {
  constructor(mj, page) {
    const words = new URLSearchParams(location.search);
    this.story = new Story(mj, page);
    this.scene = new Scene($('view'), mj, this.story.robot, { plain: words.has('plain') });
    this.paused = words.has('paused');
    this.frames = 0;
    this.choices();
    this.input();
    this.tell();
    this.show();
    requestAnimationFrame((now) => this.frame(now));
  }

  /** Buttons and lists that depend on whose policies the page has. */
  choices() {
    const { sources } = this.story;
    $('source').replaceChildren(...sources.map(({ said }, i) => new Option(said, i)));
    $('source').value = this.story.number;
    $('sources').hidden = sources.length < 2;
    const { methods } = this.story.source;
    $('methods').replaceChildren(...methods.map(({ name, said }) => {
      const button = Object.assign(document.createElement('button'), { textContent: said, onclick: () => this.follow(name) });
      button.dataset.method = name;
      return button;
    }));
    $('belief').hidden = !this.story.finds_out;
  }

  input() {
    const view = $('view');
    let down = null;
    view.addEventListener('pointerdown', (event) => { down = [event.clientX, event.clientY]; });
    view.addEventListener('pointerup', (event) => {
      if (down && Math.hypot(event.clientX - down[0], event.clientY - down[1]) < 4) this.click(this.scene.under(event));
    });
    view.addEventListener('pointermove', (event) => {
      const { leg, point } = this.scene.under(event);
      view.style.cursor = leg || (point && this.story.robot.goal) ? 'crosshair' : 'grab';
    });
    document.querySelectorAll('#legs button').forEach((button) => {
      button.onclick = () => this.click({ segment: $('what').value === LOCKED ? 'femur' : 'tibia', leg: button.dataset.leg });
    });
    $('what').onchange = () => this.tell();
    $('source').onchange = () => this.begin(Number($('source').value));
    $('fresh').onclick = () => this.begin(this.story.number, this.story.method.name);
    $('repair').onclick = () => { this.story.repair(); this.scene.wear(this.story.robot); this.tell(); };
    $('patient').onchange = () => { this.story.patience = $('patient').checked ? 60 : 0; };
  }

  click({ segment, leg, point }) {
    if (leg) this.lose(part(segment, leg, $('what').value));
    else if (point && this.story.robot.goal) this.story.robot.goal = point;
  }

  lose(name) {
    if (!this.story.lose(name)) { $('status').textContent = `This page has no robot with ${name} besides what is broken.`; return; }
    this.scene.wear(this.story.robot);
    this.tell();
  }

  follow(name) { this.story.follow(name); this.tell(); }

  begin(number, method) {
    this.story.begin(number, method);
    this.scene.tidy();
    this.scene.wear(this.story.robot);
    this.choices();
    this.tell();
  }

  /** What changes with what the visitor does. */
  tell() {
    const { story } = this, { method, source } = story;
    document.querySelectorAll('#methods button').forEach((button) => button.classList.toggle('on', button.dataset.method === method.name));
    document.querySelectorAll('#legs button').forEach((button) => {
      const leg = button.dataset.leg, lost = [...story.lost].some((own) => own.split(/[_:]/)[1] === leg);
      button.classList.toggle('gone', lost);
      button.disabled = !lost && !story.with(part($('what').value === LOCKED ? 'femur' : 'tibia', leg, $('what').value));
    });
    $('how').textContent = method.how;
    $('status').textContent = `${source.about} MuJoCo ${story.mj.mj_versionString()} in WebAssembly.`;
  }

  show() {
    const { story } = this;
    this.scene.draw(story.robot, window.innerWidth > 700 ? PANEL : 0);
    drawSpeed($('chart'), story);
    if (story.finds_out) drawBelief($('bars'), story.mind);
    $('damage').textContent = story.robot.damage;
    $('walker').textContent = story.standing > 0 ? 'stands for a moment' : `policy for ${story.walker.damage}`;
    $('speed').textContent = `${story.speed().toFixed(2)} m/s${story.robot.tipped ? ', has tipped over' : ''}`;
    this.frames += 1;
  }

  /** Physics in real time, at most a tenth of a second a frame. */
  frame(now) {
    if (!this.paused) {
      const step = this.story.page.timestep, passed = Math.min((now - (this.last ?? now)) / 1000, 0.1);
      this.debt = (this.debt ?? 0) + passed;
      for (; this.debt >= step; this.debt -= step) this.story.advance();
      this.scene.fall(passed);
      this.show();
    }
    this.last = now;
    requestAnimationFrame((next) => this.frame(next));
  }

  /** So many physics steps at once; for tests. */
  run(steps) {
    for (let i = 0; i < steps; i++) { this.story.advance(); this.scene.fall(this.story.page.timestep); }
  }

  state() {
    const { story } = this, { robot } = story;
    return {
      time: story.time, qpos: Array.from(robot.data.qpos), damage: robot.damage, walker: story.walker.damage, speed: story.speed(),
      tipped: robot.tipped, method: story.method.name, frames: this.frames, likely: story.finds_out ? story.mind.likely(3) : [],
    };
  }
}
