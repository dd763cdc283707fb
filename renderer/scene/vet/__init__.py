"""Refuses what an untrusted scene must not contain, in three looks: the XML or dictionary as text, before Mitsuba's
parser sees it (includes are read while parsing); the parsed nodes, where `$parameters` have their values; and the
headers of the files that they name, before those are loaded.
"""
