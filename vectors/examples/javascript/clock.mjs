// Virtual time in microseconds: what is to happen when. Nothing waits really.

export class Clock {
  constructor() {
    this.now = 0;
    this.queue = [];
  }

  /** Do something at this time, or now if that is past. The result cancels it. */
  at(time, action) {
    const item = { time: Math.max(time, this.now), action };
    const behind = this.queue.findIndex((other) => other.time > item.time);
    this.queue.splice(behind < 0 ? this.queue.length : behind, 0, item);
    return () => {
      item.action = () => {};
    };
  }

  /** Everything that is to happen, or all up to a time. */
  run(until = Infinity) {
    while (this.queue.length && this.queue[0].time <= until) {
      const { time, action } = this.queue.shift();
      this.now = time;
      action();
    }
    if (until !== Infinity) this.now = until;
  }
}
