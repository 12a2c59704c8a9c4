"""Methods that all clients share: written once, a coroutine in the clients for asyncio.

A client has a method for each row of the table of commands. The method only makes a `Call`; how a
call is carried out differs: `StageClient` waits for the answer, `AsyncStageClient` and `DaemonLink`
return a coroutine. `ClientMethod` therefore decorates a function that makes a call, and gives each
client the method that suits it, with the right types, name, docstring and parameters. Without it
each of the 40 methods would stand here twice.
"""

import functools
import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable, Coroutine
from typing import Any, Concatenate, Generic, ParamSpec, TypeVar, get_args, overload

from piezod.client.calls import Call, ask, command
from piezod.messages.endpoints import ENDPOINTS

ParametersT = ParamSpec("ParametersT")
ResultT = TypeVar("ResultT")


class SyncCaller(ABC):
    """A client whose methods return results."""

    @abstractmethod
    def call(self, call: Call[ResultT]) -> ResultT:
        """Carry out one call; the methods of the client make them."""


class AsyncCaller(ABC):
    """A client whose methods are coroutines."""

    @abstractmethod
    async def call(self, call: Call[ResultT]) -> ResultT:
        """Carry out one call; the methods of the client make them."""


class ClientMethod(Generic[ParametersT, ResultT]):
    """Decorator: turns a function that makes a call into a method that carries it out.

    In a `SyncCaller` the method returns the result of the call, in an `AsyncCaller` it is a
    coroutine function. It has the name, docstring and parameters of the decorated function.

    Args:
        make: Makes the call; its first parameter is `self`.
    """

    def __init__(self, make: Callable[Concatenate[Any, ParametersT], Call[ResultT]]) -> None:
        def method(
            self: SyncCaller, /, *args: ParametersT.args, **kwargs: ParametersT.kwargs
        ) -> ResultT:
            return self.call(make(self, *args, **kwargs))

        async def async_method(
            self: AsyncCaller, /, *args: ParametersT.args, **kwargs: ParametersT.kwargs
        ) -> ResultT:
            return await self.call(make(self, *args, **kwargs))

        self._method, self._async_method = _explained(method, make), _explained(async_method, make)

    @overload
    def __get__(
        self, client: SyncCaller, owner: type[SyncCaller]
    ) -> Callable[ParametersT, ResultT]: ...

    @overload
    def __get__(
        self, client: AsyncCaller, owner: type[AsyncCaller]
    ) -> Callable[ParametersT, Coroutine[Any, Any, ResultT]]: ...

    @overload
    def __get__(
        self, client: None, owner: type[SyncCaller]
    ) -> Callable[Concatenate[SyncCaller, ParametersT], ResultT]: ...

    @overload
    def __get__(
        self, client: None, owner: type[AsyncCaller]
    ) -> Callable[Concatenate[AsyncCaller, ParametersT], Coroutine[Any, Any, ResultT]]: ...

    def __get__(self, client: Any, owner: type[Any]) -> Any:
        """Return the method of a client, or of its class if `client` is None."""
        method = self._async_method if issubclass(owner, AsyncCaller) else self._method
        return method.__get__(client, owner)


class PlainMethod(ClientMethod[[], ResultT]):
    """A method without parameters, which asks the endpoint of its name.

    Args:
        answer: Class of the answer, as in the table of commands.
        what: Docstring of the method.
    """

    def __init__(self, answer: type[ResultT], what: str) -> None:
        self._answer, self._what = answer, what

    def __set_name__(self, owner: type[Any], name: str) -> None:
        """Make the method; its name is that of the endpoint."""

        def make(self: Any) -> Call[ResultT]:  # noqa: ARG001 - its signature is shown
            call: Call[Any] = ask(name) if name in ENDPOINTS else command(name)
            return call

        make.__name__, make.__qualname__ = name, f"{owner.__qualname__}.{name}"
        make.__module__, make.__doc__ = owner.__module__, self._what
        make.__annotations__["return"] = Call[self._answer]  # type: ignore[name-defined] # a class
        super().__init__(make)


FunctionT = TypeVar("FunctionT", bound=Callable[..., Any])


def _explained(method: FunctionT, make: Callable[..., Call[Any]]) -> FunctionT:
    """Give a method the name, docstring and parameters of `make`, and the result of its call."""
    functools.update_wrapper(method, make)
    signature = inspect.signature(make)
    (result,) = get_args(signature.return_annotation)
    vars(method)["__signature__"] = signature.replace(return_annotation=result)
    return method
