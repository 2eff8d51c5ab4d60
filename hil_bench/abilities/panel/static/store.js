// The last two minutes of all channels, in fixed memory, and what a pixel column needs of them.

const ROWS = 120_000;
const MOST_VALUES = 1 << 26; // of all channels: of thousands, less time is kept

export class Store {
  constructor() {
    this.begin([]);
  }

  begin(channels) {
    this.channels = channels.map(([name, unit]) => ({ name, unit }));
    this.numbers = new Map(this.channels.map(({ name }, number) => [name, number]));
    this.rows = Math.max(100, Math.min(ROWS, Math.floor(MOST_VALUES / (2 * Math.max(1, channels.length)))));
    this.times = new Float64Array(2 * this.rows);
    this.columns = channels.map(() => new Float32Array(2 * this.rows));
    this.count = 0;
    this.shift = 0; // rows that were dropped, so that row numbers stay valid
  }

  get first() {
    return this.count ? this.times[Math.max(0, this.count - this.rows)] : 0;
  }

  get last() {
    return this.count ? this.times[this.count - 1] : 0;
  }

  number(name) {
    return this.numbers.get(name) ?? -1;
  }

  push(row) {
    if (this.count === 2 * this.rows) this.drop();
    if (this.count && row[0] <= this.times[this.count - 1]) return;
    this.times[this.count] = row[0];
    for (let i = 0; i < this.columns.length; i += 1) {
      this.columns[i][this.count] = row[i + 1] ?? NaN;
    }
    this.count += 1;
  }

  drop() {
    this.times.copyWithin(0, this.rows);
    for (const column of this.columns) column.copyWithin(0, this.rows);
    this.count -= this.rows;
    this.shift += this.rows;
  }

  // Return the number of the first row at or after a time.
  find(time) {
    let low = 0;
    let high = this.count;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.times[middle] < time) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  // Return the value at a time: that of the last row until then.
  at(name, time) {
    const number = this.number(name);
    const row = Math.min(this.find(time + 1e-9), this.count) - 1;
    return number < 0 || row < 0 ? NaN : this.columns[number][row];
  }

  latest(name) {
    const number = this.number(name);
    return number < 0 || !this.count ? NaN : this.columns[number][this.count - 1];
  }

  // Return times and values of channels: all rows, or lowest and highest of each pixel column, so
  // that a spike of one row survives any zoom.
  picture(numbers, begin, end, width, factors) {
    const from = Math.max(0, this.find(begin) - 1);
    const to = Math.min(this.count, this.find(end) + 1);
    const rows = to - from;
    if (rows <= 2 * width) return this.raw(numbers, from, to, factors);
    const times = new Array(2 * width);
    for (let c = 0; c < width; c += 1) {
      times[2 * c] = this.times[from + Math.floor((c * rows) / width)];
      times[2 * c + 1] = this.times[from + Math.floor(((c + 0.5) * rows) / width)];
    }
    const values = numbers.map((number, i) =>
      extremes(this.columns[number], from, rows, width, factors[i]),
    );
    return [times, ...values];
  }

  raw(numbers, from, to, factors) {
    const times = Array.from(this.times.subarray(from, to));
    const values = numbers.map((number, i) =>
      Array.from(this.columns[number].subarray(from, to), (value) =>
        Number.isNaN(value) ? null : value / factors[i],
      ),
    );
    return [times, ...values];
  }
}

function extremes(column, from, rows, width, factor) {
  const found = new Array(2 * width);
  for (let c = 0; c < width; c += 1) {
    const end = from + Math.floor(((c + 1) * rows) / width);
    let low = Infinity;
    let high = -Infinity;
    for (let row = from + Math.floor((c * rows) / width); row < end; row += 1) {
      const value = column[row];
      if (value < low) low = value;
      if (value > high) high = value;
    }
    found[2 * c] = low === Infinity ? null : low / factor;
    found[2 * c + 1] = high === -Infinity ? null : high / factor;
  }
  return found;
}
