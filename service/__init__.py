"""The render service: jobs over HTTP, frames and error bars for the page.

Start with `service.app.create_app`.
"""
