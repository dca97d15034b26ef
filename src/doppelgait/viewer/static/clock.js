// The one time cursor that all panels follow.

export const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];

/**
 * Clock between two times in s. Its listeners get `(time, clock)` after every change: a frame of play, a seek, play or
 * pause, another speed.
 */
export function makeClock() {
  const listeners = new Set();
  let frame = null;
  let previous = 0;
  const clock = {
    start: 0, stop: 1, step: 0.02, time: 0, playing: false, speed: 1, loop: true, ready: false,
    setRange, play, pause, seek, setSpeed, setLoop, subscribe, destroy,
    toggle: () => (clock.playing ? pause() : play()),
    move: (steps) => seek(clock.time + steps * clock.step),
  };
  return clock;

  function notify() {
    for (const listener of [...listeners]) listener(clock.time, clock);
  }

  function setRange(start, stop, step) {
    Object.assign(clock, { start, stop: Math.max(stop, start), step });
    clock.time = clamp(clock.time);
    notify();
  }

  function clamp(time) {
    return Math.min(Math.max(time, clock.start), clock.stop);
  }

  function play() {
    if (clock.playing) return;
    if (clock.time >= clock.stop - 1e-9) clock.time = clock.start;
    clock.playing = true;
    previous = performance.now();
    frame = requestAnimationFrame(tick);
    notify();
  }

  function pause() {
    if (!clock.playing) return;
    cancelAnimationFrame(frame);
    clock.playing = false;
    notify();
  }

  function tick(now) {
    frame = requestAnimationFrame(tick);
    advance((Math.max(now - previous, 0) / 1000) * clock.speed);
    previous = now;
    notify();
  }

  function advance(seconds) {
    const next = clock.time + seconds;
    if (next < clock.stop) clock.time = next;
    else if (clock.loop) clock.time = clock.start;
    else {
      clock.time = clock.stop;
      cancelAnimationFrame(frame);
      clock.playing = false;
    }
  }

  function seek(time) {
    clock.time = clamp(time);
    notify();
  }

  function setSpeed(speed) {
    clock.speed = speed;
    notify();
  }

  function setLoop(loop) {
    clock.loop = loop;
    notify();
  }

  function subscribe(listener) {
    listeners.add(listener);
    return () => listeners.delete(listener);
  }

  function destroy() {
    pause();
    listeners.clear();
  }
}
