// The time that is shown: it runs, stands still, and can be set.

const LONGEST_FRAME = 0.1; // s: after a pause of the browser's the replay goes on where it was

/**
 * A clock from 0 to `duration`, s, that calls `shown()` for each frame in which it has changed or
 * something has been touched.
 */
export function clockFor(duration, shown) {
  const clock = { time: 0, rate: 1, playing: false, duration };
  let last = null;
  let asked = false;

  function frame(now) {
    asked = false;
    if (clock.playing) {
      const passed = last === null ? 0 : Math.min((now - last) / 1000, LONGEST_FRAME);
      clock.time = Math.min(clock.time + clock.rate * passed, duration);
      if (clock.time >= duration) clock.playing = false;
    }
    last = clock.playing ? now : null;
    shown();
    if (clock.playing) touch();
  }

  /** Show the next frame even if no time passes. */
  function touch() {
    if (!asked) requestAnimationFrame(frame);
    asked = true;
  }

  clock.touch = touch;
  clock.play = (on) => {
    if (on && clock.time >= duration) clock.time = 0;
    clock.playing = on;
    last = null;
    touch();
  };
  clock.seek = (time) => {
    clock.time = Math.min(Math.max(time, 0), duration);
    touch();
  };
  return clock;
}
