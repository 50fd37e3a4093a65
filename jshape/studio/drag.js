// The bars of the impulses can be dragged by their ends. This only says where a bar is wanted, once a frame; Python
// decides where it may be. While one is dragged the axes stay as they are.
"use strict";
const jshapeDrag = {
  NEAR: 16,

  attach(id) {
    const chart = getElement(id).chart, pen = chart.getZr(), axes = { xAxisIndex: 0, yAxisIndex: 0 };
    let held = null, wanted = null;
    const nearest = ({ offsetX, offsetY }) => {
      let found = null, least = this.NEAR;
      chart.getOption().series[0]?.data.forEach((pair, index) => {
        const [x, y] = chart.convertToPixel(axes, pair), away = Math.hypot(x - offsetX, y - offsetY);
        if (away < least) [found, least] = [index, away];
      });
      return found;
    };
    const send = (done) => {
      if (wanted && held !== null) emitEvent("impulse", { index: held, time: wanted[0], amplitude: wanted[1], done });
      wanted = null;
    };
    pen.on("mousedown", (event) => {
      held = nearest(event);
      chart.dispatchAction({ type: "hideTip" });
    });
    pen.on("mousemove", (event) => {
      if (held === null) {
        pen.setCursorStyle(nearest(event) === null ? "default" : "grab");
        return;
      }
      pen.setCursorStyle("grabbing");
      if (wanted === null) requestAnimationFrame(() => send(false));
      wanted = chart.convertFromPixel(axes, [event.offsetX, event.offsetY]);
    });
    const release = () => {
      if (held === null) return;
      wanted = wanted ?? [null, null];
      send(true);
      held = null;
    };
    pen.on("mouseup", release);
    pen.on("globalout", release);
  },
};
