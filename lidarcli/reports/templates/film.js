// Pictures to step through, at their own pace.
const source = document.getElementById("data");
const [film, words, slider, play] = ["film", "words", "slider", "play"].map((name) => document.getElementById(name));
if (source) {
  const { frames, words: texts, seconds } = JSON.parse(source.textContent);
  let at = Number(slider.value);
  let timer = 0;
  const show = (number) => {
    at = Math.min(Math.max(number, 0), frames.length - 1);
    film.src = frames[at];
    film.alt = `The scene from above at ${texts[at]}`;
    words.textContent = texts[at];
    slider.value = at;
  };
  const stop = () => {
    clearTimeout(timer);
    timer = 0;
    play.textContent = "Play";
  };
  const go = () => {
    play.textContent = "Stop";
    const wait = at + 1 < frames.length ? 1000 * (seconds[at + 1] - seconds[at]) : 1000;
    timer = setTimeout(() => {
      show(at + 1 < frames.length ? at + 1 : 0);
      go();
    }, Math.min(wait, 1000));
  };
  const step = (number) => {
    stop();
    show(number);
  };
  const turn = () => (timer ? stop() : go());
  slider.addEventListener("input", () => step(Number(slider.value)));
  play.addEventListener("click", turn);
  document.getElementById("back").addEventListener("click", () => step(at - 1));
  document.getElementById("forward").addEventListener("click", () => step(at + 1));
  document.addEventListener("keydown", (event) => {
    if (event.target.closest("button, input, a, summary") && event.key !== "ArrowLeft" && event.key !== "ArrowRight") return;
    const actions = { ArrowLeft: () => step(at - 1), ArrowRight: () => step(at + 1), " ": turn };
    if (!(event.key in actions)) return;
    event.preventDefault();
    actions[event.key]();
  });
}
