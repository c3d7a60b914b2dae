// A CANopen device (CiA 301): network management, error control and the way of a frame to its service.

import { NotOffered, hex, little, parseBytes, showBytes } from '../hex.mjs';
import { Clock } from '../clock.mjs';
import { Dictionary, valueBytes } from './dictionary.mjs';
import { Emergencies } from './errors.mjs';
import { HeartbeatConsumer, NodeGuarding } from './guard.mjs';
import { DeviceLss } from './lss.mjs';
import { Pdos } from './pdo.mjs';
import { OPERATIONAL, PRE_OPERATIONAL, STOPPED, cob, matches, parseFrame } from './cob.mjs';
import { Sync } from './sync.mjs';
import { writeRules } from './rules.mjs';
import { SdoServer } from '../canopen/sdo-server.mjs';

const COMMANDS = { 0x01: OPERATIONAL, 0x02: STOPPED, 0x80: PRE_OPERATIONAL };
const [RESET_NODE, RESET_COMMUNICATION] = [0x81, 0x82];
const COMMUNICATION = [0x1000, 0x1fff];
const ALL = [0x1000, 0x9fff];

export class Device {
  constructor({ id, objects, lss }) {
    Object.assign(this, { id, clock: new Clock(), said: [], state: null, life: 0 });
    this.emergencies = new Emergencies(this);
    this.dictionary = new Dictionary(objects, {
      computed: {
        '1001:00': () => [this.emergencies.register],
        '1200:01': () => little(0x600 + this.id, 4), // whatever the case says: the node-ID is added to it
        '1200:02': () => little(0x580 + this.id, 4),
        ...this.emergencies.history(objects),
      },
      rules: writeRules(this),
      wrote: (index, sub, changed) => this.wrote(index, sub, changed),
    });
    this.guarding = new NodeGuarding(this);
    this.consumer = new HeartbeatConsumer(this);
    this.sync = new Sync(this);
    this.pdos = new Pdos(this);
    this.lss = lss ? new DeviceLss(this) : null;
    this.boot();
  }

  number(index, sub, otherwise = 0) {
    return this.dictionary.number(index, sub, otherwise);
  }

  /** Do something after a time, unless the device is reset before. The result cancels it. */
  after(delay, action) {
    const life = this.life;
    return this.clock.at(this.clock.now + delay, () => life === this.life && action());
  }

  say({ id, extended }, data) {
    const digits = showBytes(data).replaceAll(' ', '');
    this.said.push(`${hex(id, extended ? 8 : 3)}#${digits}`);
  }

  sayOn(id, data) {
    this.say({ id, extended: false }, data);
  }

  communicates() {
    return this.state === PRE_OPERATIONAL || this.state === OPERATIONAL;
  }

  // -------------------------------------------------------------------------------------------------------------- NMT

  boot() {
    this.life += 1;
    this.state = null;
    if (this.id === null) return;
    this.servers = this.sdoServers();
    for (const service of [this.emergencies, this.guarding, this.consumer, this.sync, this.pdos]) service.reset();
    this.state = PRE_OPERATIONAL;
    this.sayOn(0x700 + this.id, [0]);
    this.sync.restart();
    this.restartHeartbeat();
  }

  reset(range) {
    this.dictionary.reset(range);
    this.id = this.lss ? this.lss.nodeAfterReset() : this.id;
    this.boot();
  }

  command(code) {
    if (code === RESET_NODE) this.reset(ALL);
    else if (code === RESET_COMMUNICATION) this.reset(COMMUNICATION);
    else if (code in COMMANDS) this.enter(COMMANDS[code]);
  }

  enter(state) {
    if (state === this.state) return;
    const old = this.state;
    this.state = state;
    if (old === OPERATIONAL) this.pdos.stop();
    if (state === OPERATIONAL) this.pdos.start();
    if (state === STOPPED) this.servers = this.sdoServers();
    if (old === STOPPED) this.sync.counter = 0;
  }

  /** What 1029h:01 says of an operational device that has lost a node. */
  errorBehaviour() {
    if (this.state !== OPERATIONAL) return;
    const choice = this.number(0x1029, 1);
    if (choice === 0) this.enter(PRE_OPERATIONAL);
    if (choice === 2) this.enter(STOPPED);
  }

  restartHeartbeat() {
    this.stopHeartbeat?.();
    const period = this.number(0x1017, 0) * 1000;
    if (period === 0) return;
    this.stopHeartbeat = this.after(period, () => {
      this.sayOn(0x700 + this.id, [this.state]);
      this.restartHeartbeat();
    });
  }

  // -------------------------------------------------------------------------------------------------------------- SDO

  /** The servers: the first one on 600h and 580h, the others where 1201h and so on say. */
  sdoServers() {
    const servers = [{ index: 0x1200, server: new SdoServer(this.dictionary) }];
    for (let index = 0x1201; index <= 0x127f; index += 1) {
      if (this.dictionary.has(index, 1)) servers.push({ index, server: new SdoServer(this.dictionary) });
    }
    return servers;
  }

  channel(index) {
    if (index === 0x1200) {
      const [request, answer] = [0x600, 0x580].map((base) => cob(base + this.id));
      return { request, answer, on: true };
    }
    const [request, answer] = [1, 2].map((sub) => cob(this.number(index, sub)));
    return { request, answer, on: !request.bit31 && !answer.bit31 };
  }

  hearSdo(frame) {
    for (const { index, server } of this.servers) {
      const { request, answer, on } = this.channel(index);
      if (on && matches(request, frame)) for (const data of server.hear(frame.data)) this.say(answer, data);
    }
  }

  wrote(index, sub, changed) {
    if (index === 0x1017) this.restartHeartbeat();
    if (index === 0x100c || index === 0x100d) this.guarding.restart();
    if (index === 0x1016) this.consumer.reset();
    if (index === 0x1005 || index === 0x1006) this.sync.restart();
    if (changed) this.pdos.changed(index, sub);
  }

  // ----------------------------------------------------------------------------------------------------------- frames

  hear(text) {
    const frame = parseFrame(text);
    if (this.lss && frame.id === 0x7e5) this.lss.hear(text);
    if (this.id === null) return;
    const plain = !frame.extended && !frame.remote;
    if (plain && frame.id === 0 && frame.data.length === 2) {
      if (frame.data[1] === 0 || frame.data[1] === this.id) this.command(frame.data[0]);
      return;
    }
    if (!frame.extended && frame.remote && frame.id === 0x700 + this.id) this.guarding.asked();
    if (plain && frame.id > 0x700 && frame.id < 0x780 && frame.data.length >= 1) this.consumer.heard(frame.id - 0x700);
    if (!this.communicates()) return;
    if (!frame.remote && matches(this.sync.cob(), frame)) this.sync.heard(frame.data);
    if (!frame.remote) this.hearSdo(frame);
    if (this.state === OPERATIONAL) this.pdos.heard(frame);
  }

  act({ set, value, error, info = '', clear }) {
    if (set) {
      const [index, sub] = set.split(':').map((part) => parseInt(part, 16));
      this.dictionary.store(index, sub, valueBytes(this.dictionary.entry(index, sub).type, value));
    }
    if (error) this.emergencies.occurs(error, parseInt(error, 16), parseBytes(info));
    if (clear) this.emergencies.ends(clear);
  }
}

function run({ device: settings, talk }) {
  const multiplexed = ({ object, value }) => /^1(6|A)..:00$/.test(object) && (value === '254' || value === '255');
  if (settings.objects.some(multiplexed)) throw new NotOffered('no multiplexed PDOs');
  const device = new Device(settings);
  const steps = talk.map(({ at, hear = [], act = [] }) => {
    device.clock.run(at);
    for (const frame of hear) device.hear(frame);
    for (const one of act) device.act(one);
    return { say: device.said.splice(0) };
  });
  return { talk: steps };
}

export const KINDS = { device: { run } };
