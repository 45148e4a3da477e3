/** The worker as an object with promises. */

import type { Calls, Reply, Request } from './protocol';

interface Waiting {
  resolve: (result: never) => void;
  reject: (error: Error) => void;
}

export class Engine {
  private readonly worker = new Worker(new URL('./worker.ts', import.meta.url), { type: 'module' });
  private readonly waiting = new Map<number, Waiting>();
  private nextId = 0;

  constructor(onProgress: (loaded: number, total: number) => void) {
    this.worker.onmessage = ({ data }: MessageEvent<Reply>) => {
      if (data.kind === 'progress') onProgress(data.loaded, data.total);
      else this.settle(data);
    };
    this.worker.onerror = (event) => this.fail(new Error(event.message || 'the worker stopped'));
  }

  call<C extends keyof Calls>(call: C, ...args: Parameters<Calls[C]>): Promise<ReturnType<Calls[C]>> {
    const request: Request = { id: this.nextId++, call, args };
    return new Promise((resolve, reject) => {
      this.waiting.set(request.id, { resolve, reject });
      this.worker.postMessage(request);
    });
  }

  stop(): void {
    this.worker.terminate();
    this.fail(new Error('the worker was stopped'));
  }

  private settle(reply: Exclude<Reply, { kind: 'progress' }>): void {
    const waiting = this.waiting.get(reply.id);
    this.waiting.delete(reply.id);
    if (reply.kind === 'result') waiting?.resolve(reply.result as never);
    else waiting?.reject(new Error(reply.message));
  }

  private fail(error: Error): void {
    for (const { reject } of this.waiting.values()) reject(error);
    this.waiting.clear();
  }
}
