// The alarm: what is wrong with the rig stands in the tab's title, and is heard until it is silenced.

const PAUSE_MS = 10000; // between two sounds, so that whoever works at the rig can still be heard
const TONES = [880, 660, 880]; // Hz: two that are told apart from one that a machine makes
const TONE_S = 0.18;
const GAP_S = 0.06;

export class Alarm {
  // button: silences the alarm that sounds, and is hidden while none does.
  constructor(button) {
    this.button = button;
    this.word = null; // what is wrong; empty for nothing, null before anything is known
    this.sounded = 0;
    this.timer = 0;
    button.addEventListener("click", () => this.silence());
    // A browser lets no page sound before somebody has touched it.
    for (const kind of ["pointerdown", "keydown"]) {
      document.addEventListener(kind, () => this.sound?.resume(), { capture: true });
    }
  }

  // Takes how the rig stands: its tone and its word, and the rig's name for the title.
  take(tone, word, rig) {
    const wrong = tone === "bad" ? word : "";
    const title = `${wrong ? `✕ ${wrong} - ` : ""}${rig || "Rig"} console`;
    if (document.title !== title) document.title = title;
    if (wrong === this.word) return;
    const isFirst = this.word === null;
    this.word = wrong;
    this.silence();
    // What was so before the page was opened is no news.
    if (wrong && !isFirst) this.begin();
  }

  begin() {
    this.button.hidden = false;
    this.timer = setInterval(() => this.play(), PAUSE_MS);
    this.play();
  }

  silence() {
    clearInterval(this.timer);
    this.timer = 0;
    this.button.hidden = true;
  }

  play() {
    this.sounded += 1;
    try {
      this.sound ??= new AudioContext();
      this.sound.resume();
      TONES.forEach((frequency, k) => this.tone(frequency, this.sound.currentTime + k * (TONE_S + GAP_S)));
    } catch { /* A machine without a loudspeaker still has the title and the page. */ }
  }

  tone(frequency, at) {
    const tone = new OscillatorNode(this.sound, { frequency });
    // It swells and fades within a hundredth of a second, so that it does not crack.
    const volume = new GainNode(this.sound, { gain: 0 });
    volume.gain.linearRampToValueAtTime(0, at);
    volume.gain.linearRampToValueAtTime(0.3, at + 0.01);
    volume.gain.setValueAtTime(0.3, at + TONE_S - 0.01);
    volume.gain.linearRampToValueAtTime(0, at + TONE_S);
    tone.connect(volume).connect(this.sound.destination);
    tone.start(at);
    tone.stop(at + TONE_S);
  }
}
