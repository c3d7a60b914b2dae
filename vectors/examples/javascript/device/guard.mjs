// Error control of a device: node guarding with life guarding (100Ch, 100Dh), and the consumer of heartbeats (1016h).

const LOST = 0x8130;

export class NodeGuarding {
  constructor(device) {
    this.device = device;
  }

  reset() {
    Object.assign(this, { toggle: 0, since: null }); // since: the last request; it watches from the first one on
    this.stop?.();
  }

  /** A remote frame of the master: the state with the toggle bit, and the life time begins again. */
  asked() {
    const { device } = this;
    if (device.number(0x1017, 0) !== 0) return;
    device.emergencies.ends('master');
    device.sayOn(0x700 + device.id, [device.state | (this.toggle << 7)]);
    this.toggle ^= 1;
    this.since = device.clock.now;
    this.restart();
  }

  /** The life time counts from the last request on, with the present values of 100Ch and 100Dh. */
  restart() {
    const { device } = this;
    this.stop?.();
    const life = device.number(0x100c, 0) * device.number(0x100d, 0) * 1000;
    if (life === 0 || this.since === null) return;
    this.stop = device.after(this.since + life - device.clock.now, () => {
      device.emergencies.occurs('master', LOST);
      device.errorBehaviour();
    });
  }
}

export class HeartbeatConsumer {
  constructor(device) {
    Object.assign(this, { device, watches: new Map() });
  }

  /** Every entry of 1016h waits for the first heartbeat of its node. */
  reset() {
    for (const { stop } of this.watches.values()) stop();
    this.watches.clear();
  }

  timeOf(node) {
    const { dictionary } = this.device;
    for (const sub of dictionary.subs(0x1016).filter((one) => one > 0)) {
      const value = dictionary.number(0x1016, sub);
      if (Math.floor(value / 0x10000) === node && value % 0x10000 !== 0) return (value % 0x10000) * 1000;
    }
    return 0;
  }

  heard(node) {
    const time = this.timeOf(node);
    if (time === 0) return;
    const { device } = this;
    device.emergencies.ends(`node ${node}`);
    this.watches.get(node)?.stop();
    const stop = device.after(time, () => {
      device.emergencies.occurs(`node ${node}`, LOST, [node]);
      device.errorBehaviour();
    });
    this.watches.set(node, { stop });
  }
}
