"""The lessons."""

import argparse
import webbrowser

from app.teaching import Teacher, find_lessons, open_teaching
from app.terminal import Voice


def teach(given: argparse.Namespace, voice: Voice) -> None:
    """The lessons, until Ctrl-C, or only their names."""
    found = find_lessons(given.own)
    if given.list:
        told = Teacher(found).listed(voice.tell.language)["words"]
        for name in found:
            voice.say(voice.tell("teach.line", name=name, title=told[f"lesson.{name}.title"]))
        return
    with open_teaching(found, given.host, given.port, given.language) as page:
        url = f"{page.url}&lesson={given.lesson}" if given.lesson else page.url
        voice.say(voice.tell("teach.open", url=url))
        if not given.no_browser:
            webbrowser.open(url)
        page.wait()
