(function () {
  "use strict";
  var button = document.getElementById("unfold");
  var open = false;
  button.hidden = false;
  button.addEventListener("click", function () {
    open = !open;
    document.querySelectorAll("details").forEach(function (fold) { fold.open = open; });
    button.textContent = open ? "Fold everything" : "Unfold everything";
  });
})();
