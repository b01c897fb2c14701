// Rows of numbers as they come: decoding, and the ring that keeps the last of them.

const headBytes = 24;
export const keptBytes = 48 * 2 ** 20;

/// One binary message of kind 1: {first, rows, columns, values}; throws where it is none.
export function decode(buffer) {
  const view = new DataView(buffer);
  if (buffer.byteLength < headBytes || view.getUint32(0, true) !== 1)
    throw new Error('a binary message of unknown kind');
  const rows = view.getUint32(4, true), columns = view.getUint32(8, true);
  if (buffer.byteLength !== headBytes + rows * columns * 8)
    throw new Error(`${rows} rows of ${columns} columns in ${buffer.byteLength} bytes`);
  return { first: Number(view.getBigUint64(16, true)), rows, columns, values: values(buffer, rows * columns) };
}

/// Of kind 2, poses: {row, bodies, values}, seven numbers a body; null where it is no message of poses.
export function decodePoses(buffer) {
  const view = new DataView(buffer), head = 16;
  if (buffer.byteLength < head || view.getUint32(0, true) !== 2) return null;
  const bodies = view.getUint32(4, true), count = 7 * bodies;
  if (buffer.byteLength !== head + 4 * count) throw new Error(`${bodies} poses in ${buffer.byteLength} bytes`);
  const values = littleEndian ? new Float32Array(buffer, head, count)
    : Float32Array.from({ length: count }, (_, i) => view.getFloat32(head + 4 * i, true));
  return { row: Number(view.getBigUint64(8, true)), bodies, values };
}

const littleEndian = new Uint8Array(new Uint16Array([1]).buffer)[0] === 1;
function values(buffer, count) {
  if (littleEndian) return new Float64Array(buffer, headBytes, count);
  const view = new DataView(buffer);
  return Float64Array.from({ length: count }, (_, i) => view.getFloat64(headBytes + 8 * i, true));
}

/// The last rows, first column time_s. Rows have running numbers; a gap is kept as one row without values.
export class Ring {
  constructor(columns) {
    this.columns = columns;
    this.capacity = Math.max(2, Math.floor(keptBytes / (8 * columns)));
    this.values = new Float64Array(this.capacity * columns);
    this.numbers = new Float64Array(this.capacity);
    this.clear();
  }

  clear() {
    this.written = 0;
    this.received = 0;
    this.lost = 0;
    this.next = null;
  }

  get begin() {
    return Math.max(0, this.written - this.capacity);
  }
  get end() {
    return this.written;
  }

  at(index, column) {
    return this.values[(index % this.capacity) * this.columns + column];
  }
  time(index) {
    return this.at(index, 0);
  }
  /// Its running number, as the program counts rows.
  number(index) {
    return this.numbers[index % this.capacity];
  }

  add(message) {
    if (message.columns !== this.columns)
      throw new Error(`rows of ${message.columns} columns, ${this.columns} were announced`);
    if (this.next !== null && message.first < this.next) this.clear();  // the program began anew
    if (this.next !== null && message.first > this.next) {
      this.lost += message.first - this.next;
      this.gap();
    }
    for (let row = 0; row < message.rows; ++row) {
      const from = row * this.columns;
      const to = (this.written % this.capacity) * this.columns;
      this.values.set(message.values.subarray(from, from + this.columns), to);
      this.numbers[this.written % this.capacity] = message.first + row;
      ++this.written;
    }
    this.received += message.rows;
    this.next = message.first + message.rows;
  }

  gap() {
    if (this.written === 0) return;
    const at = (this.written % this.capacity) * this.columns;
    const time = this.time(this.written - 1);
    this.values.fill(NaN, at, at + this.columns);
    this.values[at] = time;
    ++this.written;
  }

  /// The newest row that holds values; -1 without one.
  get last() {
    return this.end > this.begin ? this.end - 1 : -1;
  }

  /// The first row at or after `time_s`.
  find(time_s) {
    let low = this.begin, high = this.end;
    while (low < high) {
      const middle = Math.floor((low + high) / 2);
      if (this.time(middle) < time_s) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  /// The row with values whose time is nearest; -1 without one.
  nearest(time_s) {
    let best = -1, distance = Infinity;
    const at = this.find(time_s);
    for (let i = Math.max(this.begin, at - 2); i < Math.min(this.end, at + 2); ++i) {
      const off = Math.abs(this.time(i) - time_s);
      if (off < distance && !Number.isNaN(this.at(i, this.columns - 1))) [best, distance] = [i, off];
    }
    return best;
  }
}
