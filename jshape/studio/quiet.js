// What changes with every movement of a slider is written past Vue, which would go through all elements of the page; it
// finds the same value when it does so next.
const jshapeQuiet = {
  keep(id, value) {
    Vue.toRaw(mounted_app.elements[id]).props["model-value"] = value;
    jshapeScene.moved = performance.now();
  },
  show(id, value) {
    this.keep(id, value);
    const input = getElement(id)?.getNativeElement();
    if (input) input.value = value;
  },
};
// Whether curves are being computed, and of which change of the page.
const jshapeBusy = (busy, change) => {
  const main = document.querySelector(".studio-main");
  main.ariaBusy = String(busy);
  main.dataset.change = String(change);
};
