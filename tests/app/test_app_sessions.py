"""Files of a session are its own, and gone when it ends."""

import threading
import time

import pytest

from uniart_jax.app.sessions import Sessions


@pytest.fixture
def sessions(tmp_path):
    return Sessions(tmp_path)


def upload(sessions, text="x", name="a.png"):
    file = sessions.root / f"hash-{text}" / name
    file.parent.mkdir(exist_ok=True)
    file.write_text(text)
    return {"path": str(file)}


def files(sessions):
    return sorted(p.name for p in sessions.root.rglob("*") if p.is_file())


def test_a_session_takes_its_uploads_and_results_along(sessions):
    one, other = sessions.of("one"), sessions.of("other")
    sessions.take(one, upload(sessions))
    (sessions.fresh(one, "object") / "object.zip").write_text("z")
    (sessions.fresh(other, "object") / "theirs.zip").write_text("z")
    assert files(sessions) == ["a.png", "object.zip", "theirs.zip"]
    sessions.close("one")
    assert files(sessions) == ["theirs.zip"]
    assert not (sessions.root / "hash-x").exists()
    sessions.close("one")  # twice is once
    assert one.closed


def test_what_two_sessions_uploaded_goes_with_the_last(sessions):
    payload = upload(sessions)
    for name in ("one", "other"):
        sessions.take(sessions.of(name), payload)
    sessions.close("one")
    assert files(sessions) == ["a.png"]
    sessions.close("other")
    assert files(sessions) == []


def test_what_was_there_at_first_stays(sessions):
    payload = upload(sessions)
    sessions.keep_present()
    sessions.take(sessions.of("one"), payload)
    sessions.close("one")
    assert files(sessions) == ["a.png"]


def test_new_results_replace_old_ones_of_their_kind(sessions):
    session = sessions.of("one")
    for kind, name in (("picture", "seen"), ("object", "first"), ("object", "second")):
        (sessions.fresh(session, kind) / name).write_text(name)
    assert files(sessions) == ["second", "seen"]


def test_folders_cannot_be_guessed(sessions):
    folders = {sessions.of(str(i)).folder.name for i in range(8)}
    assert len(folders) == 8 and all(len(name) == 32 for name in folders)


def test_work_that_goes_on_is_told_and_its_files_go_when_it_has_stopped(sessions):
    session = sessions.of("one")
    with sessions.working(session):
        (sessions.fresh(session, "object") / "half").write_text("half")
        sessions.close("one")
        assert session.closed and files(sessions) == ["half"]
    assert files(sessions) == []


def test_a_shared_upload_stays_while_work_of_a_page_that_was_left_reads_it(sessions):
    payload = upload(sessions)
    for name in ("one", "other"):
        sessions.take(sessions.of(name), payload)
    with sessions.working(sessions.of("one")):
        sessions.close("one")
        sessions.close("other")
        sessions.sweep(unclaimed=-1)
        assert files(sessions) == ["a.png"]
    assert files(sessions) == []


def test_a_late_request_of_a_page_that_was_left_keeps_what_it_reads(sessions):
    payload = upload(sessions)
    sessions.take(sessions.of("other"), payload)
    sessions.of("one")
    sessions.close("one")
    with sessions.working(sessions.of("one")):  # it came after the word that the page is left
        sessions.take(sessions.of("one"), payload)
        sessions.close("other")
        assert files(sessions) == ["a.png"]
    assert files(sessions) == []


def test_a_page_that_was_left_is_not_opened_again_by_its_last_requests(sessions, monkeypatch):
    session = sessions.of("one")
    sessions.close("one")
    assert sessions.of("one") is session and session.closed
    sessions.take(session, upload(sessions))  # the upload was faster than the word that it ended
    assert files(sessions) == []
    monkeypatch.setattr("uniart_jax.app.sessions.LATE", 0.0)
    back = sessions.of("one")  # a browser that was away for a while
    assert back is not session and not back.closed
    sessions.take(back, upload(sessions))
    assert files(sessions) == ["a.png"]


def test_uploads_of_nobody_and_silent_sessions_go_after_a_time(sessions):
    upload(sessions, "kept", "example.png")
    sessions.keep_present()
    mine = sessions.of("mine")
    sessions.take(mine, upload(sessions, "mine", "mine.png"))
    (sessions.fresh(mine, "object") / "object.zip").write_text("z")
    upload(sessions, "nobody", "orphan.png")
    sessions.sweep()
    assert files(sessions) == ["example.png", "mine.png", "object.zip", "orphan.png"]
    sessions.sweep(unclaimed=-1)
    assert files(sessions) == ["example.png", "mine.png", "object.zip"]
    assert not (sessions.root / "hash-nobody").exists()
    with sessions.working(mine):
        sessions.sweep(unused=-1)
        assert not mine.closed
    sessions.sweep(unused=-1)
    assert mine.closed and files(sessions) == ["example.png"]


def test_at_the_end_everything_goes(sessions):
    session, stopped = sessions.of("one"), []

    def work():
        with sessions.working(session):
            while not session.closed:
                time.sleep(0.01)
            stopped.append(True)

    thread = threading.Thread(target=work)
    thread.start()
    upload(sessions)
    while not session.works:
        time.sleep(0.01)
    sessions.close_all()
    thread.join()
    assert stopped and not sessions.root.exists()


@pytest.mark.parametrize("payload", [None, "x.png", {}, {"path": 3}])
def test_no_picture_is_said(sessions, payload):
    with pytest.raises(ValueError, match="no picture"):
        sessions.take(sessions.of("one"), payload)


def test_files_of_others_are_not_taken(sessions, tmp_path_factory):
    outside = tmp_path_factory.mktemp("outside") / "secret.png"
    outside.write_text("secret")
    inside = sessions.fresh(sessions.of("other"), "object") / "theirs.png"
    inside.write_text("theirs")
    link = sessions.root / "link.png"
    link.symlink_to(outside)
    up = sessions.root / ".." / outside.parent.name / "secret.png"
    for path in (outside, inside, link, up):
        with pytest.raises(ValueError, match="not one that was uploaded"):
            sessions.take(sessions.of("one"), {"path": str(path)})
    with pytest.raises(FileNotFoundError, match=r"gone\.png: it is not here any more"):
        sessions.take(sessions.of("one"), {"path": str(sessions.root / "gone.png")})
