"""Serving: planner and agents over WebSocket, in worker processes.

Takes messages of clients (`runs.messages`); gives what the commands and agents answer. It reads no file for a client.
"""
