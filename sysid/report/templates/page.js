(function () {
  "use strict";

  // Fold and unfold everything, for reading and for printing.
  var button = document.getElementById("unfold");
  var open = false;
  button.hidden = false;
  button.addEventListener("click", function () {
    open = !open;
    document.querySelectorAll("details").forEach(function (fold) { fold.open = open; });
    document.body.classList.toggle("all", open);
    button.textContent = open ? "Fold everything" : "Unfold everything";
  });

  // Cautions are folded on the screen and never on paper.
  window.addEventListener("beforeprint", function () {
    document.querySelectorAll("details.printed").forEach(function (fold) { fold.open = true; });
  });

  var MISSING = -32768;
  var GREY = "#9aa5b1", PALE = "#e4e7eb", INK = "#1f2933", MUTED = "#52606d", WARNING = "#b03a00";

  function octets(text) {
    return Uint8Array.from(atob(text), function (c) { return c.charCodeAt(0); });
  }

  function unpack(text, scale) {
    var bytes = octets(text);
    var view = new DataView(bytes.buffer);
    var values = new Float64Array(bytes.length / 2);
    for (var i = 0; i < values.length; i++) {
      var code = view.getInt16(2 * i, true);
      values[i] = code === MISSING ? NaN : code * scale;
    }
    return values;
  }

  function scaled(text, step) {
    return Float64Array.from(new Int8Array(octets(text).buffer), function (code) { return code * step; });
  }

  // Ends of the posterior's band and of the band of new readings, as distances from the simulated curve.
  function bands(channel) {
    if (!channel.band_low) return null;
    var low = scaled(channel.band_low, channel.band_step), high = scaled(channel.band_high, channel.band_step);
    var reading = function (side) {
      return low.map(function (v, i) { return (v + high[i]) / 2 + side * Math.hypot((high[i] - v) / 2, channel.scatter); });
    };
    return { low: low, high: high, readingLow: reading(-1), readingHigh: reading(1) };
  }

  function element(parent, name, attributes, text) {
    var made = document.createElementNS(parent.namespaceURI, name);
    Object.keys(attributes).forEach(function (key) { made.setAttribute(key, attributes[key]); });
    if (text !== undefined) made.textContent = text;
    parent.appendChild(made);
    return made;
  }

  function extent(curves) {
    var low = Infinity, high = -Infinity;
    curves.forEach(function (values) {
      values.forEach(function (v) { if (v < low) low = v; if (v > high) high = v; });
    });
    if (!(high > low)) { low = (low || 0) - 1; high = low + 2; }
    var margin = 0.05 * (high - low);
    return [low - margin, high + margin];
  }

  function ticks(low, high, most) {
    var raw = (high - low) / most;
    var power = Math.pow(10, Math.floor(Math.log10(raw)));
    var step = power * [1, 2, 5, 10].find(function (m) { return m * power >= raw; });
    var found = [];
    for (var k = Math.ceil(low / step); k * step <= high; k++) found.push(k * step);
    var places = Math.max(0, -Math.floor(Math.log10(step)));
    return found.map(function (v) { return [v, signed(v, places)]; });
  }

  function signed(value, places) {
    var text = Math.abs(value).toFixed(places);
    return (value < 0 && Number(text) !== 0 ? "\u2212" : "") + text;
  }

  function path(values, x, y) {
    var parts = [], pen = false;
    for (var i = 0; i < values.length; i++) {
      if (isNaN(values[i])) { pen = false; continue; }
      parts.push((pen ? "L" : "M") + x(i).toFixed(1) + " " + y(values[i]).toFixed(1));
      pen = true;
    }
    return parts.join("");
  }

  function area(low, high, x, y) {
    var there = [], back = [];
    for (var i = 0; i < low.length; i++) {
      there.push(x(i).toFixed(1) + " " + y(high[i]).toFixed(1));
      back.unshift(x(i).toFixed(1) + " " + y(low[i]).toFixed(1));
    }
    return "M" + there.concat(back).join("L") + "Z";
  }

  function explorer(root) {
    var runs = JSON.parse(root.querySelector("script[type='application/json']").textContent);
    var runBox = root.querySelector("[data-part=run]"), channelBox = root.querySelector("[data-part=channel]");
    var slider = root.querySelector("[data-part=time]"), output = root.querySelector("output");
    var plot = root.querySelector("[data-part=plot]");
    var state = null;

    function fill(box, names) {
      var kept = box.selectedOptions.length ? box.selectedOptions[0].textContent : "";
      box.textContent = "";
      names.forEach(function (name, i) {
        var option = document.createElement("option");
        option.value = String(i);
        option.textContent = name;
        option.selected = name === kept;
        box.appendChild(option);
      });
    }

    function frame(svg, box, range, times, unit, last) {
      var x = function (t) { return box.left + (t - times[0]) / (times[1] - times[0]) * box.width; };
      var y = function (v) { return box.top + (range[1] - v) / (range[1] - range[0]) * box.height; };
      ticks(range[0], range[1], Math.max(3, box.height / 30)).forEach(function (t) {
        element(svg, "path", { d: "M" + box.left + " " + y(t[0]) + "h" + box.width, stroke: PALE });
        element(svg, "text", { x: box.left - 6, y: y(t[0]) + 4, "text-anchor": "end", fill: MUTED }, t[1]);
      });
      ticks(times[0], times[1], Math.max(3, box.width / 90)).forEach(function (t) {
        element(svg, "path", { d: "M" + x(t[0]) + " " + box.top + "v" + box.height, stroke: PALE });
        if (last) element(svg, "text", { x: x(t[0]), y: box.top + box.height + 16, "text-anchor": "middle", fill: MUTED }, t[1]);
      });
      element(svg, "text", { x: box.left, y: box.top - 6, fill: INK }, unit);
      if (last) element(svg, "text", { x: box.left + box.width / 2, y: box.top + box.height + 33, "text-anchor": "middle", fill: INK }, "time [s]");
      return { x: x, y: y };
    }

    function draw() {
      var run = runs[Number(runBox.value)], channel = run.channels[Number(channelBox.value)];
      if (!channel) { plot.textContent = "This run has no such record."; return; }
      var curve = {};
      ["measured", "middle", "low", "high"].forEach(function (name) {
        if (channel[name]) curve[name] = unpack(channel[name], channel.scale);
      });
      var count = curve.middle.length, times = [run.start, run.start + run.step * (count - 1)];
      var difference = curve.measured && curve.measured.map(function (v, i) { return v - curve.middle[i]; });
      (channel.clipped || []).forEach(function (i) { if (difference) difference[i] = NaN; });
      var band = bands(channel);
      var width = Math.max(280, plot.clientWidth), height = difference ? 400 : 300;
      plot.textContent = "";
      var label = run.name + ", " + channel.name + ": " + (difference ? "measured, simulated and their difference" : "load ratio") + " against time";
      // A shallow copy of a figure of this page: an SVG element without naming its namespace.
      var svg = plot.appendChild(document.querySelector("svg.figure").cloneNode(false));
      svg.removeAttribute("class");
      var size = { viewBox: "0 0 " + width + " " + height, width: width, height: height, role: "img", "aria-label": label, "font-size": 12, fill: "none" };
      Object.keys(size).forEach(function (key) { svg.setAttribute(key, size[key]); });
      var left = 52, inner = width - left - 10;
      var main = { left: left, top: 30, width: inner, height: difference ? 210 : 220 };
      var range = extent([curve.measured, curve.middle, curve.low, curve.high].filter(Boolean));
      var unit = (difference ? "" : "dynamic / static load ") + "[" + channel.unit + "]";
      var upper = frame(svg, main, range, times, unit, !difference);
      var at = function (i) { return upper.x(run.start + i * run.step); };
      if (curve.low) element(svg, "path", { d: area(curve.low, curve.high, at, upper.y), fill: channel.color, "fill-opacity": 0.3 });
      function fill(low, high, y, base, opacity) {
        var moved = function (ends) { return base ? ends.map(function (v, i) { return v + base[i]; }) : ends; };
        element(svg, "path", { class: "band", d: area(moved(low), moved(high), at, y), fill: channel.color, "fill-opacity": opacity });
      }
      function fillBands(y, base) {
        fill(band.readingLow, band.readingHigh, y, base, 0.16);
        fill(band.low, band.high, y, base, 0.45);
      }
      if (band) fillBands(upper.y, curve.middle);
      if (curve.measured) element(svg, "path", { d: path(curve.measured, at, upper.y), stroke: GREY, "stroke-width": 3 });
      element(svg, "path", { class: "simulated", d: path(curve.middle, at, upper.y), stroke: channel.color, "stroke-width": 1.3 });
      (channel.clipped || []).forEach(function (i) {
        if (!isNaN(curve.measured[i])) element(svg, "circle", { cx: at(i), cy: upper.y(curve.measured[i]), r: 2.5, fill: WARNING });
      });
      if (difference) {
        var below = { left: left, top: 275, width: inner, height: 80 };
        var reach = extent([difference, [-1.3 * channel.scatter, 1.3 * channel.scatter]].concat(band ? [band.readingLow, band.readingHigh] : []));
        var lower = frame(svg, below, reach, times, "measured \u2212 simulated [" + channel.unit + "]", true);
        if (band) fillBands(lower.y, null);
        else element(svg, "rect", { x: left, width: inner, y: lower.y(channel.scatter), height: Math.max(0, lower.y(-channel.scatter) - lower.y(channel.scatter)), fill: channel.color, "fill-opacity": 0.2 });
        element(svg, "path", { d: path(difference, at, lower.y), stroke: MUTED });
      }
      var cursor = element(svg, "path", { stroke: INK, "stroke-dasharray": "3 3", visibility: "hidden" });
      slider.max = String(count - 1);
      state = { run: run, channel: channel, curve: curve, band: band, difference: difference, cursor: cursor, x: upper.x, left: left, inner: inner, height: difference ? 355 : 250, width: width, count: count };
      output.textContent = (run.every > 1 ? "One of " + run.every + " samples is shown. " : "") + (difference
        ? "Grey: measured. Coloured: simulated. " + (band ? "Darker band: 90 % of the posterior; lighter band: 90 % of new readings, posterior and residual scatter together." : "Band below: 90 % of the scatter that the fit assigns to this channel.") + (channel.clipped && channel.clipped.length ? " Dots: clipped readings." : "")
        : "Line: median" + (curve.low ? "; band: pointwise 90 % credible interval." : " (least squares, no band yet)."));
    }

    function show(index) {
      if (!state) return;
      var i = Math.min(Math.max(Math.round(index), 0), state.count - 1), unit = state.channel.unit === "-" ? "" : "\u00a0" + state.channel.unit;
      var time = state.run.start + i * state.run.step, curve = state.curve;
      var value = function (v) { return isNaN(v) ? "missing" : signed(v, state.channel.unit === "-" ? 3 : 2) + unit; };
      state.cursor.setAttribute("d", "M" + state.x(time).toFixed(1) + " 30V" + state.height);
      state.cursor.setAttribute("visibility", "visible");
      slider.value = String(i);
      slider.setAttribute("aria-valuetext", signed(time, 3) + " s");
      output.textContent = "At " + signed(time, 3) + "\u00a0s: " + (curve.measured
        ? "measured " + value(curve.measured[i]) + ", simulated " + value(curve.middle[i]) + ", difference " + value(state.difference[i])
          + (state.band ? ", 90\u00a0% posterior [" + value(curve.middle[i] + state.band.low[i]) + ", " + value(curve.middle[i] + state.band.high[i]) + "]" : "")
        : "median " + value(curve.middle[i]) + (curve.low ? ", 90\u00a0% interval [" + value(curve.low[i]) + ", " + value(curve.high[i]) + "]" : ""));
    }

    function channels() {
      fill(channelBox, runs[Number(runBox.value)].channels.map(function (c) { return c.name; }));
      draw();
    }

    root.hidden = false;
    fill(runBox, runs.map(function (run) { return run.name; }));
    channels();
    runBox.addEventListener("change", channels);
    channelBox.addEventListener("change", draw);
    slider.addEventListener("input", function () { show(Number(slider.value)); });
    plot.addEventListener("pointermove", function (event) {
      if (!state) return;
      var box = plot.firstElementChild.getBoundingClientRect();
      show(((event.clientX - box.left) / box.width * state.width - state.left) / state.inner * (state.count - 1));
    });
    var width = plot.clientWidth;
    window.addEventListener("resize", function () {
      if (plot.clientWidth !== width) { width = plot.clientWidth; draw(); }
    });
  }

  document.querySelectorAll(".explorer").forEach(explorer);

  // Long tables: rows that hold the words of the search, in the order of the column whose head was pressed.
  function longTable(root) {
    var box = root.querySelector("input"), output = root.querySelector("output"), body = root.querySelector("tbody");
    var rows = Array.from(body.rows), words = rows.map(function (row) { return row.textContent.toLowerCase(); });
    var order = new Intl.Collator(undefined, { numeric: true });

    function search() {
      var asked = box.value.toLowerCase().split(/\s+/).filter(Boolean), shown = 0;
      rows.forEach(function (row, i) {
        row.hidden = !asked.every(function (word) { return words[i].includes(word); });
        shown += row.hidden ? 0 : 1;
      });
      output.textContent = asked.length ? shown + " of " + rows.length : "";
    }

    function sort(head) {
      var down = head.getAttribute("aria-sort") === "ascending", numbers = head.classList.contains("num");
      root.querySelectorAll("th[aria-sort]").forEach(function (other) { other.removeAttribute("aria-sort"); });
      head.setAttribute("aria-sort", down ? "descending" : "ascending");
      var keys = new Map(rows.map(function (row) {
        var text = row.cells[head.cellIndex].textContent.trim();
        return [row, numbers ? parseFloat(text.replace("\u2212", "-")) : text];
      }));
      var none = function (key) { return numbers ? isNaN(key) : key === ""; };
      body.append.apply(body, Array.from(keys.keys()).sort(function (a, b) {
        var x = keys.get(a), y = keys.get(b);
        if (none(x) || none(y)) return none(x) - none(y);
        return (down ? -1 : 1) * (numbers ? x - y : order.compare(x, y));
      }));
    }

    root.querySelector("p").hidden = false;
    box.addEventListener("input", search);
    root.querySelectorAll("thead th").forEach(function (head) {
      var name = head.textContent;
      head.textContent = "";
      element(head, "button", { type: "button", title: "Sort by " + name }, name)
        .addEventListener("click", function () { sort(head); });
    });
  }

  document.querySelectorAll(".long").forEach(longTable);
})();
