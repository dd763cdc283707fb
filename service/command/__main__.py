"""`python -m service.command`: as `fredholm`."""

from service.command.main import main

main()
