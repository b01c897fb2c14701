// The WebSocket: opened again after it was lost, at growing intervals.
import { decode, decodePoses } from './rows.js';

const firstWait_ms = 250, longestWait_ms = 5000, silence_ms = 4000;

/// Calls on.message(object), on.rows(decoded), on.poses(decoded), on.state({up, text, waiting}), on.problem(text).
export class Connection {
  constructor(on) {
    this.on = on;
    this.wait_ms = firstWait_ms;
    this.socket = null;
    this.open();
    addEventListener('online', () => this.retry());
    setInterval(() => this.watch(), 1000);
  }

  open() {
    clearTimeout(this.timer);
    this.timer = null;
    const address = new URL('/live' + location.search, location.href);
    address.protocol = location.protocol === 'https:' ? 'wss:' : 'ws:';
    const socket = new WebSocket(address, 'tribotwin.live.v1');
    socket.binaryType = 'arraybuffer';
    this.socket = socket;
    this.heard = performance.now();
    socket.onopen = () => this.on.state({ up: true, text: 'connected' });
    socket.onmessage = ({ data }) => this.receive(data);
    socket.onclose = ({ code, reason }) => socket === this.socket && this.closed(code, reason);
  }

  receive(data) {
    this.heard = performance.now();
    this.wait_ms = firstWait_ms;
    try {
      const poses = data instanceof ArrayBuffer ? decodePoses(data) : null;
      if (poses) this.on.poses(poses);
      else if (data instanceof ArrayBuffer) this.on.rows(decode(data));
      else this.on.message(JSON.parse(data));
    } catch (problem) {
      this.on.problem(`A message was not understood: ${problem.message}`);
    }
  }

  closed(code, reason) {
    const wait_ms = this.wait_ms * (0.75 + 0.5 * Math.random());  // ten viewers do not all come at once
    this.wait_ms = Math.min(longestWait_ms, 2 * this.wait_ms);
    const why = reason ? ` (${reason})` : code === 1008 || code === 1009 ? ` (refused, code ${code})` : '';
    this.on.state({ up: false, text: `connection lost${why}; next try in ${(wait_ms / 1000).toFixed(1)} s` });
    this.timer = setTimeout(() => this.open(), wait_ms);
  }

  retry() {
    if (this.timer !== null) this.open();
  }

  /// A socket that is open and says nothing is no connection either: status comes five times a second.
  watch() {
    if (this.socket.readyState !== WebSocket.OPEN || document.hidden) return;
    const silent_ms = performance.now() - this.heard;
    if (silent_ms > silence_ms)
      this.on.state({ up: true, stale: true, text: `connected, but silent for ${(silent_ms / 1000).toFixed(0)} s` });
    else this.on.state({ up: true, text: 'connected' });
  }

  /// Whether it was sent.
  send(message) {
    if (this.socket.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }
}
