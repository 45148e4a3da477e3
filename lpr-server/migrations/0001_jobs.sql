-- Jobs, the one ordered history of what happened to them, and the answers to requests that may be sent twice.

CREATE TABLE jobs (
    -- A UUID of version 7: the order of identifiers is that of creation.
    id TEXT NOT NULL PRIMARY KEY,
    task TEXT NOT NULL,
    spec TEXT NOT NULL,
    state TEXT NOT NULL,
    reason TEXT,
    message TEXT,
    -- Of the worker that holds the job: what an earlier one still writes is refused.
    attempt INTEGER NOT NULL,
    created_at TEXT NOT NULL,
    started_at TEXT,
    finished_at TEXT,
    summary TEXT
) STRICT;

CREATE INDEX jobs_by_state ON jobs (state, id);

CREATE TABLE events (
    -- Never given twice, also after the newest events have been deleted: streams go on from a number.
    seq INTEGER PRIMARY KEY AUTOINCREMENT,
    job TEXT NOT NULL REFERENCES jobs (id),
    kind TEXT NOT NULL,
    -- Of a metric only.
    env_steps INTEGER,
    data TEXT NOT NULL
) STRICT;

CREATE INDEX events_of_job ON events (job, seq);
CREATE INDEX events_of_kind ON events (job, kind, seq);

CREATE TABLE idempotency (
    key TEXT NOT NULL PRIMARY KEY,
    spec TEXT NOT NULL,
    job TEXT NOT NULL REFERENCES jobs (id),
    response TEXT NOT NULL
) STRICT;
