"""Sessions of the lab without the loop that steps them."""


def update(session):
    """Reads, checks and flies again whatever is new in the folder, now."""
    session._list()
    while session._looking or session._next_look():
        looking = session._looking or session._looker.submit(session._next_look())
        session._looking = None
        session._add(looking.result())


def finish(session):
    """Reads what is there and waits until it is traced."""
    update(session)
    while (job := session._next_job()) and not job.proposes:
        session._worker.start(job)
        while not (answer := session._worker.wait(60.0)):
            pass
        session._take(answer)
