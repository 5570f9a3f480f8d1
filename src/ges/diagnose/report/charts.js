/* Charts over time: recorded and simulated signals of one flight, a chart a channel, zoomed together.
 * The data is that of charts.py; the charts are drawn by uPlot. Without JavaScript, and in print,
 * the page shows a picture instead. */
(function () {
  "use strict";
  const host = document.getElementById("plots");
  if (!host || typeof uPlot === "undefined") return;
  const data = JSON.parse(document.getElementById("series").textContent);
  const MISSING = -32768;
  const STYLES = {
    recorded: { stroke: "#1b1b1b", width: 1.6 },
    before: { stroke: "#8a8a8a", width: 1.2, dash: [2, 3] },
    recalibrated: { stroke: "#2b8cc4", width: 1.4, dash: [7, 4] },
    after: { stroke: "#d55e00", width: 1.6 },
  };
  const BLOCKS = {
    force: "forces", acc: "accelerometer", moment: "moments", drive: "rotor speeds",
    range: "rangefinder", p: "position, simulated 1 s ahead", v: "velocity, simulated 1 s ahead",
  };
  const choose = {
    flight: document.getElementById("choose-flight"),
    block: document.getElementById("choose-block"),
    what: document.getElementById("choose-what"),
  };
  const labels = Object.fromEntries(data.stages);
  let plots = [];

  function option(select, value, text) {
    const o = document.createElement("option");
    o.value = value;
    o.textContent = text;
    select.appendChild(o);
  }

  /* Numbers of two bytes, little-endian, as charts.py packs them. */
  function unpacked(channel, stage) {
    const text = atob(channel.series[stage]), values = new Array(text.length / 2);
    for (let i = 0; i < values.length; i++) {
      const n = (text.charCodeAt(2 * i) | (text.charCodeAt(2 * i + 1) << 8)) << 16 >> 16;
      values[i] = n === MISSING ? null : channel.low + channel.step * (n + 32767);
    }
    return values;
  }

  /* What is drawn of one channel: signals, or recorded less each model. */
  function drawn(channel, differences) {
    const recorded = unpacked(channel, "recorded"), rows = [];
    for (const [stage] of data.stages) {
      if (stage !== "recorded") {
        const model = unpacked(channel, stage);
        rows.push([stage, differences
          ? model.map((v, i) => (v === null || recorded[i] === null ? null : recorded[i] - v))
          : model]);
      } else if (!differences) rows.push([stage, recorded]);
    }
    return rows;
  }

  /* Left-out spans behind the curves, each with its reason where there is room. */
  function shaded(leftOut) {
    return function (u) {
      const { ctx, bbox } = u;
      ctx.save();
      ctx.beginPath();
      ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
      ctx.clip();
      ctx.font = 11 * devicePixelRatio + "px sans-serif";
      ctx.textBaseline = "top";
      for (const [from, to, reason] of leftOut) {
        const x = u.valToPos(from, "x", true), w = u.valToPos(to, "x", true) - x;
        ctx.fillStyle = "rgba(120, 120, 120, 0.16)";
        ctx.fillRect(x, bbox.top, w, bbox.height);
        const words = "left out: " + reason, left = Math.max(x, bbox.left) + 4;
        if (ctx.measureText(words).width + 8 < Math.min(x + w, bbox.left + bbox.width) - left) {
          ctx.fillStyle = "#666";
          ctx.fillText(words, left, bbox.top + 3);
        }
      }
      ctx.restore();
    };
  }

  /* Range of what is used and visible: a blow on the ground would flatten all else. */
  function ranged(used) {
    return function (u) {
      const [first, last] = u.series[0].idxs || [0, used.length - 1];
      let low = Infinity, high = -Infinity, lowAll = Infinity, highAll = -Infinity;
      for (let k = 1; k < u.series.length; k++) {
        if (!u.series[k].show) continue;
        for (let i = first; i <= last; i++) {
          const v = u.data[k][i];
          if (v === null || v === undefined) continue;
          lowAll = Math.min(lowAll, v);
          highAll = Math.max(highAll, v);
          if (!used[i]) continue;
          low = Math.min(low, v);
          high = Math.max(high, v);
        }
      }
      if (low > high) [low, high] = lowAll > highAll ? [-1, 1] : [lowAll, highAll];
      const room = 0.08 * (high - low) || Math.abs(high) || 1;
      return [low - room, high + room];
    };
  }

  function show() {
    const flight = data.flights[+choose.flight.value], differences = choose.what.value === "left";
    plots.forEach((u) => u.destroy());
    plots = [];
    host.textContent = "";
    const channels = flight.channels.filter((c) => c.block === choose.block.value);
    for (const channel of channels) {
      const rows = drawn(channel, differences), unit = channel.unit ? ", " + channel.unit : "";
      const options = {
        width: host.clientWidth,
        height: innerWidth < 560 ? 170 : 200,
        title: channel.label + unit + (differences ? ": recorded less simulated" : ""),
        cursor: { sync: { key: "time" }, points: { size: 5 }, drag: { x: true, y: false } },
        scales: { x: { time: false }, y: { range: ranged(flight.used) } },
        axes: [{ label: "time, s", labelSize: 18, size: 34 }, { size: 58 }],
        series: [
          { label: "time, s", value: (u, v) => (v === null ? "" : v.toFixed(2)) },
          ...rows.map(([stage]) => ({
            label: labels[stage],
            points: { show: false },
            spanGaps: false,
            value: (u, v) => (v === null || v === undefined ? "" : v.toPrecision(4)),
            ...STYLES[stage],
          })),
        ],
        hooks: { drawClear: [shaded(flight.left_out)] },
      };
      plots.push(new uPlot(options, [flight.t_s, ...rows.map(([, v]) => v)], host));
    }
  }

  /* The channels that this flight has; the block that was chosen stays where it can. */
  function listBlocks() {
    const flight = data.flights[+choose.flight.value], last = choose.block.value;
    const blocks = [...new Set(flight.channels.map((c) => c.block))];
    choose.block.textContent = "";
    blocks.forEach((b) => option(choose.block, b, BLOCKS[b] || b));
    if (blocks.includes(last)) choose.block.value = last;
  }

  /* All charts to a stretch ``factor`` times as long, moved by ``shift`` of what is visible. */
  function zoom(factor, shift) {
    if (!plots.length) return;
    const t = data.flights[+choose.flight.value].t_s, first = t[0], last = t[t.length - 1];
    const { min, max } = plots[0].scales.x;
    const length = Math.min(factor * (max - min), last - first);
    const start = 0.5 * (min + max - length) + shift * length;
    const from = Math.max(first, Math.min(start, last - length));
    plots.forEach((u) => u.setScale("x", { min: from, max: from + length }));
  }

  data.flights.forEach((f, i) =>
    option(choose.flight, i, f.name + (f.held_out ? " (took no part)" : "")));
  choose.flight.value = data.shown;
  listBlocks();
  choose.flight.addEventListener("change", () => { listBlocks(); show(); });
  choose.block.addEventListener("change", show);
  choose.what.addEventListener("change", show);
  const buttons = {
    in: [0.5, 0], out: [2, 0], earlier: [1, -0.5], later: [1, 0.5], whole: [Infinity, 0],
  };
  for (const [name, move] of Object.entries(buttons)) {
    document.getElementById("zoom-" + name).addEventListener("click", () => zoom(...move));
  }
  document.documentElement.classList.add("live");
  show();
  let width = host.clientWidth;
  new ResizeObserver(() => {
    if (host.clientWidth && host.clientWidth !== width) {
      width = host.clientWidth;
      plots.forEach((u) => u.setSize({ width, height: u.height }));
    }
  }).observe(host);
})();

/* What is folded on a screen is read on paper. */
addEventListener("beforeprint", () =>
  document.querySelectorAll("details:not([open])").forEach((d) => {
    d.open = true;
    d.dataset.folded = "";
  }));
addEventListener("afterprint", () =>
  document.querySelectorAll("details[data-folded]").forEach((d) => { d.open = false; }));
