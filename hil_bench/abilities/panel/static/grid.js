// Places on the grid of a layout: moved and sized within it, and no item over another.

export const COLUMNS = 12;
const ROWS = 160; // the last row in which an item may begin
const TALLEST = 40;

const within = (low, value, high) => Math.min(high, Math.max(low, value));

export function move(item, columns, rows) {
  item.column = within(1, item.column + columns, COLUMNS - item.width + 1);
  item.row = within(1, item.row + rows, ROWS);
}

export function resize(item, columns, rows) {
  item.width = within(1, item.width + columns, COLUMNS - item.column + 1);
  item.height = within(1, item.height + rows, TALLEST);
}

// Push items down until none overlaps another; `held` stays where it is.
export function arrange(items, held) {
  const placed = [held];
  const rest = items.filter((item) => item !== held).sort((one, other) => one.row - other.row);
  for (const item of rest) {
    for (let below = overlapping(item, placed); below; below = overlapping(item, placed)) {
      item.row = within(1, below.row + below.height, ROWS);
      if (item.row === ROWS) break;
    }
    placed.push(item);
  }
}

function overlapping(item, others) {
  return others.find((other) =>
    item.column < other.column + other.width && other.column < item.column + item.width &&
    item.row < other.row + other.height && other.row < item.row + item.height);
}
