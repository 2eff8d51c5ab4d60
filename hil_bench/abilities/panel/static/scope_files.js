// What the scope saves: pictures that stand alone, rows as CSV in the units shown, and as MF4 in SI.

import { download, setText } from "./dom.js";
import { csvFile, drawPicture, pngFile, svgFile } from "./picture.js";

export class ScopeFiles {
  constructor(scope) {
    this.scope = scope;
  }

  async savePicture(form) {
    const { name, bench, program } = this.scope.model.hello ?? {};
    const { A: a = null, B: b = null } = this.scope.plots.cursors;
    const cursors = [["A", a], ["B", b]].filter(([, time]) => time !== null).map(([cursor, time]) => `${cursor} at ${time.toFixed(4)} s`);
    if (a !== null && b !== null) cursors.push(`B \u2212 A = ${((b - a) * 1e3).toFixed(2)} ms`);
    const picture = drawPicture(this.scope.plots, {
      title: `${name}: ${bench ?? ""}`,
      foot: [cursors.join(" · "), `${program ?? "hil-bench"}, saved ${new Date().toISOString().slice(0, 19).replace("T", " ")} UTC`].filter(Boolean),
    });
    try {
      download(`scope.${form}`, form === "svg" ? svgFile(picture) : await pngFile(picture));
      setText(this.scope.said, "");
    } catch (error) {
      setText(this.scope.said, `scope.${form}: cannot be drawn: ${error.message}`);
    }
  }

  // Return the channels that are shown with their units, and the rows between the edges.
  shownRows() {
    const { store } = this.scope.model;
    const channels = this.scope.plots.names.map((name) => [name, this.scope.model.unit(name)]);
    const columns = channels.map(([name]) => store.columns[store.number(name)]);
    return { channels, columns, from: store.find(this.scope.begin_s), to: store.find(this.scope.end_s + 1e-9) };
  }

  async saveMeasurement() {
    const { channels, columns, from, to } = this.shownRows();
    const width = 1 + channels.length;
    const rows = new Float64Array((to - from) * width);
    for (let row = from; row < to; row += 1) {
      const begin = (row - from) * width;
      rows[begin] = this.scope.model.store.times[row];
      for (let i = 0; i < columns.length; i += 1) rows[begin + 1 + i] = columns[i][row];
    }
    const { name, bench } = this.scope.model.hello ?? {};
    const head = `${JSON.stringify({ comment: `scope of ${name}, ${bench}`, channels })}\n`;
    try {
      download("scope.mf4", await this.scope.model.link.post("mf4", new Blob([head, rows])));
      setText(this.scope.said, "");
    } catch (error) {
      setText(this.scope.said, error.message);
    }
  }

  saveTable() {
    download("scope.csv", csvFile({ ...this.shownRows(), times: this.scope.model.store.times }));
  }
}
