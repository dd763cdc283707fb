/** The same render asked for from elsewhere: as a command line and as a Python program. */
import type { Job } from './types';

/** What was asked for, without what was left to the scene. */
function request(job: Job): object {
  const present = (record: object): object =>
    Object.fromEntries(Object.entries(record).filter(([, value]) => value !== null && value !== undefined));
  const scene = job.scene.gallery ? { gallery: job.scene.gallery } : { id: job.scene.id };
  return { scene, target: present(job.target), settings: present(job.settings), ...(job.priority && { priority: job.priority }) };
}

export function asCurl(job: Job, base: string): string {
  const quoted = JSON.stringify(request(job)).replaceAll("'", "'\\''");
  return `curl -sS ${new URL('api/jobs', base).href} -H 'content-type: application/json' -d '${quoted}'`;
}

/** Submits, waits and saves the EXR, with Python's own library alone. */
export function asPython(job: Job, base: string): string {
  return `import json, time, urllib.request

SERVICE = ${JSON.stringify(new URL('api/', base).href)}
JOB = json.loads(r'''${JSON.stringify(request(job)).replaceAll("'", '\\u0027')}''')


def call(path, body=None):
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(SERVICE + path, data, {"content-type": "application/json"})
    with urllib.request.urlopen(request) as answer:
        return answer.read()


job = json.loads(call("jobs", JOB))
while job["state"] not in ("succeeded", "failed", "cancelled"):
    time.sleep(1)
    job = json.loads(call("jobs/" + job["id"]))
    print(job["state"], job["error"])
with open("${fileNameOf(job)}.exr", "wb") as file:
    file.write(call("jobs/" + job["id"] + "/image.exr"))
`;
}

/** A job's name as the beginning of a file's. */
export const fileNameOf = (job: Job): string => job.name.replace(/\.(zip|xml)$/, '').replace(/[^\w-]+/g, '-');
