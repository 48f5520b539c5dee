// The WebSocket to the program: it is opened again by itself, after growing pauses, when it is lost.

/** ended: what answers at the address is another program, which knows this page no more. stopped: nothing has answered
 *  for minutes, and only the user tries again. */
export type Link = "connecting" | "open" | "lost" | "stopped" | "ended";

interface Listener {
  opened(): void;
  text(message: string): void;
  binary(message: ArrayBuffer): void;
  changed(link: Link): void;
}

/** Seconds to wait before the n-th attempt; after the last of these nothing is tried any more. */
const PAUSES = [0.5, 1, 2, 4, ...Array<number>(36).fill(8)];

export class Connection {
  private socket: WebSocket | undefined;
  private failures = 0;
  private timer: ReturnType<typeof setTimeout> | undefined;
  link: Link = "connecting";

  /** @param page  where the program answers requests that know its secret */
  constructor(
    private readonly address: string,
    private readonly page: string,
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
      this.later();
    };
  }

  private later(): void {
    const pause = PAUSES[this.failures++];
    if (pause === undefined) return this.set("stopped");
    this.set("lost");
    clearTimeout(this.timer);
    this.timer = setTimeout(() => void this.attempt(), 1000 * pause);
  }

  /** A socket that is refused does not say why: a request does. */
  private async attempt(): Promise<void> {
    try {
      const { status } = await fetch(this.page, { method: "HEAD", cache: "no-store" });
      if (status === 403 || status === 404) return this.set("ended");
    } catch {
      return this.later();
    }
    this.open();
  }

  /** Tries at once instead of at the end of the pause. */
  retry(): void {
    if (this.socket || this.link === "ended") return;
    clearTimeout(this.timer);
    if (this.link === "stopped") {
      this.failures = 0;
      this.set("lost");
    }
    void this.attempt();
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
