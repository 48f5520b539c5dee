// The WebSocket to the program: it is opened again by itself, after growing pauses, when it is lost.

export type Link = "connecting" | "open" | "lost";

interface Listener {
  opened(): void;
  text(message: string): void;
  binary(message: ArrayBuffer): void;
  changed(link: Link): void;
}

/** Seconds to wait before the n-th attempt. */
const PAUSES = [0.5, 1, 2, 4, 8];

export class Connection {
  private socket: WebSocket | undefined;
  private failures = 0;
  private timer: ReturnType<typeof setTimeout> | undefined;
  link: Link = "connecting";

  constructor(
    private readonly address: string,
    private readonly listener: Listener,
  ) {
    this.open();
  }

  private set(link: Link): void {
    if (link === this.link) return;
    this.link = link;
    this.listener.changed(link);
  }

  private open(): void {
    const socket = new WebSocket(this.address);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.onopen = () => {
      this.failures = 0;
      this.set("open");
      this.listener.opened();
    };
    socket.onmessage = ({ data }: MessageEvent<string | ArrayBuffer>) =>
      typeof data === "string" ? this.listener.text(data) : this.listener.binary(data);
    socket.onclose = () => {
      if (socket !== this.socket) return;
      this.socket = undefined;
      this.set("lost");
      const pause = PAUSES[Math.min(this.failures++, PAUSES.length - 1)]!;
      this.timer = setTimeout(() => this.open(), 1000 * pause);
    };
  }

  /** Tries at once instead of at the end of the pause. */
  retry(): void {
    if (this.socket) return;
    clearTimeout(this.timer);
    this.open();
  }

  /** Whether an earlier message is still on its way: a newer one may replace those that wait behind it. */
  get busy(): boolean {
    return (this.socket?.bufferedAmount ?? 0) > 0;
  }

  /** @returns whether it was sent */
  send(message: object): boolean {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }
}
